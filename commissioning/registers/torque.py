"""The torque switch of one servo: on without a leap, and off."""

from functools import partial

from commissioning.errors import CommissioningError
from commissioning.scan.find import FoundServo
from commissioning.scan.identify import surely
from drivers.bus.confirm import confirmed_states
from drivers.bus.types import ServoState


def hold_where_it_stands(servo: FoundServo) -> None:
    """Tell the servo its own position as goal, then switch its torque on. Nothing moves.

    Raises CommissioningError where it cannot be held there: in another mode, or beyond its own limits.
    """
    servo_id, series, bus = servo.servo_id, servo.series, servo.bus
    if wrong := series.config_error(servo.model, servo.read):
        raise CommissioningError(f"servo {servo_id}: {wrong}")
    state = confirmed_states(bus.read_states, [servo_id])[servo_id]
    if not isinstance(state, ServoState):
        raise CommissioningError(f"{state.text}: its torque stays off")
    limits = bus.position_limits(servo_id)
    if limits and not limits[0] <= state.position_counts <= limits[1]:
        raise CommissioningError(
            f"servo {servo_id}: stands at {state.position_counts}, beyond its limits {limits[0]} to {limits[1]}, and "
            "would leap to the nearer one: turn it there by hand first"
        )
    surely(partial(bus.write, servo_id, series.goal_position, state.position_counts))
    bus.torque_on(servo_id)
    if not servo.holds_torque():
        raise CommissioningError(f"servo {servo_id}: does not switch its torque on: 'servoloop scan' shows its alarms")


def let_go(servo: FoundServo) -> None:
    """Switch the torque off. What the servo held falls."""
    servo.bus.torque_off([servo.servo_id])
    if servo.holds_torque():
        raise CommissioningError(f"servo {servo.servo_id}: still holds torque: switch its supply off")
