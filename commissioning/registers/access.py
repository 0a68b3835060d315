"""Registers of one servo: the whole table, one value, one careful write.

with find_servo(port, clock, 3) as servo:
    print(read_register(servo, "present_voltage").text)
    write_register(servo, "max_temperature", "65C")
"""

from dataclasses import dataclass
from functools import partial
from typing import Final

from calibration.eeprom import update
from commissioning.errors import CommissioningError
from commissioning.registers.tables import register_named, registers_of
from commissioning.registers.values import RegisterValue, parse, value_of
from commissioning.scan.find import FoundServo
from commissioning.scan.identify import surely
from drivers.bus.confirm import confirmed_states
from drivers.bus.types import ServoState
from drivers.errors import ServoRefused
from drivers.servos.register import Access, Register


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


ELSEWHERE: Final = {
    "id": "'servoloop set-id' changes it",
    "baud_rate": "'servoloop set-baud' changes it",
    "protocol_type": "it takes the servo off this line",
    "lock": "the tools open and close it themselves",
}
GOALS: Final = ("goal_position", "goal_velocity", "goal_time", "goal_pwm", "goal_current", "moving_speed")
"""Orders to move: an STS servo that is limp switches its torque on for them."""
CORRECTS_S: Final = 0.005
"""An STS servo takes a value over as it is written, and corrects it a millisecond later."""


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """What a write has changed; ``before`` and ``after`` are alike where the servo held the value already."""

    servo_id: int
    before: RegisterValue
    after: RegisterValue

    @property
    def changed(self) -> bool:
        """Whether anything was written."""
        return self.before.raw != self.after.raw


def list_registers(servo: FoundServo) -> tuple[RegisterValue, ...]:
    """The table of the servo's model with present values."""
    return tuple(value_of(servo.model, register, _held(servo, register)) for register in registers_of(servo.model))


def read_register(servo: FoundServo, name: str) -> RegisterValue:
    """One register."""
    register = register_named(servo.model, name)
    return value_of(servo.model, register, servo.read(register))


def write_register(servo: FoundServo, name: str, value: str | int, *, torque: bool = False) -> RegisterWrite:
    """Write one register and read it back. ``value``: raw, or a quantity with its unit.

    EEPROM is written under its lock and only where it differs. Refused are goals, and everything under torque but the
    torque switch, which takes ``torque``: with 1 the servo is held where it stands, with 0 it lets go.
    """
    register, raw = register_named(servo.model, name), value_to_write(servo, name, value)
    before = value_of(servo.model, register, servo.read(register))
    if register == servo.series.torque_enable:
        _switch(servo, raw, torque)
    elif raw != before.raw:
        if servo.holds_torque():
            raise CommissioningError(
                f"servo {servo.servo_id}: {name} is not written while it holds torque. Support the arm, then "
                f"'servoloop register write --id {servo.servo_id} torque_enable 0'"
            )
        _write(servo, register, raw)
    return RegisterWrite(servo.servo_id, before, value_of(servo.model, register, servo.read(register)))


def value_to_write(servo: FoundServo, name: str, value: str | int) -> int:
    """The raw value that ``write_register`` is to write; nothing is sent. Raises CommissioningError."""
    register = register_named(servo.model, name)
    raw = parse(servo.model, register, str(value))
    check_writable(servo, register, raw)
    return raw


def check_writable(servo: FoundServo, register: Register, raw: int) -> None:
    """Raise CommissioningError for what no user should write by hand."""
    name = register.name
    text = ""
    if register.access is Access.READ:
        text = "can only be read"
    elif name in ELSEWHERE:
        text = f"is not written by hand: {ELSEWHERE[name]}"
    elif name in GOALS:
        text = "is an order to move, and to a limp STS servo to switch its torque on: 'servoloop up' gives goals"
    elif register == servo.series.status_level and raw == 0:
        text = "0 keeps the servo from answering"
    elif register == servo.series.torque_enable and raw not in (0, 1):
        text = f"takes 0 (off) and 1 (on) here, not {raw}: other values move the servo's zero or brake its motor"
    if text:
        raise CommissioningError(f"servo {servo.servo_id}: {name} {text}")


def _switch(servo: FoundServo, raw: int, torque: bool) -> None:
    if not torque:
        raise CommissioningError(f"servo {servo.servo_id}: its torque is not switched unless you say so (--yes)")
    if raw:
        hold_where_it_stands(servo)
    else:
        let_go(servo)


def _write(servo: FoundServo, register: Register, raw: int) -> None:
    servo_id, series = servo.servo_id, servo.series
    if register.persistent:
        try:
            update(servo.bus, servo_id, series.lock, {register: raw})
        except ValueError as error:
            raise CommissioningError(f"servo {servo_id}: {error}") from error
        return
    bus = servo.bus
    surely(partial(bus.write, servo_id, register, raw))
    servo.clock.sleep_until(servo.clock.now() + CORRECTS_S)
    if (held := servo.read(register)) != raw:
        raise CommissioningError(f"servo {servo_id}: {register.name} stays {held}, not {raw}: it does not take it")


def _held(servo: FoundServo, register: Register) -> int | None:
    try:
        return servo.read(register)
    except ServoRefused:  # not in this firmware
        return None
