"""Read and write the registers of one servo.

with find_servo(port, clock, 3) as servo:
    print(read_register(servo, "present_voltage").text)
    write_register(servo, "max_temperature", "65C")
"""

from dataclasses import dataclass
from functools import partial
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.tables import register_named
from commissioning.registers.values import RegisterValue, parse, value_of
from commissioning.scan.find import FoundServo
from commissioning.scan.identify import retry_often
from drivers.bus.confirm import confirmed_states
from drivers.driver_errors import ServoRefused
from drivers.eeprom import update
from drivers.servos import x
from drivers.servos.catalog import registers_of
from drivers.servos.dynamixel import X
from drivers.servos.register import Access, Register
from drivers.types import ServoState


def enable_torque_in_place(servo: FoundServo) -> None:
    """Set the servo's goal to its measured position, then enable torque, so that the servo does not move.

    Raises CommissioningError if the servo cannot hold this position, because it is in another mode or outside its
    limits.
    """
    servo_id, series, bus = servo.servo_id, servo.series, servo.bus
    if wrong := series.config_error(servo.model, servo.read):
        raise CommissioningError(f"servo {servo_id}: {wrong}")
    state = confirmed_states(bus.read_states, [servo_id])[servo_id]
    if not isinstance(state, ServoState) and bus.needs_single_reads(servo_id):
        state = confirmed_states(bus.read_states, [servo_id])[servo_id]
    if not isinstance(state, ServoState):
        raise CommissioningError(f"{state.text}: its torque stays disabled")
    if series is X and x.within_turn(state.position_counts, servo.read(x.homing_offset)) != state.position_counts:
        raise CommissioningError(
            f"servo {servo_id}: its position {state.position_counts} includes full turns, which are lost "
            f"when its torque is enabled. Restart the servo first with 'servoloop reboot {servo_id} --port {bus.name}'"
        )
    limits = bus.position_limits(servo_id)
    if limits and not limits[0] <= state.position_counts <= limits[1]:
        raise CommissioningError(
            f"servo {servo_id}: its position {state.position_counts} is outside its limits {limits[0]} to "
            f"{limits[1]}, so the servo would jump to the nearer limit. Turn its shaft into this range by hand first"
        )
    retry_often(partial(bus.write, servo_id, series.goal_position, state.position_counts))
    bus.torque_on(servo_id)
    if not servo.holds_torque():
        raise CommissioningError(
            f"servo {servo_id}: its torque could not be enabled. Check its alarms with 'servoloop scan {bus.name}'"
        )


WEAK_SHARE: Final = 0.5
"""Torque limit in RAM, as a fraction of the limit in EEPROM, below which a servo may not hold its load."""


def weak_torque(servo: FoundServo) -> str:
    """Return a warning if another program has left a low torque limit in the servo's RAM; otherwise, return an empty
    string."""
    volatile, persistent = servo.series.torque_limit, servo.series.max_torque
    if volatile is None:
        return ""
    limit, highest = servo.read(volatile), servo.read(persistent)
    if limit >= WEAK_SHARE * highest:
        return ""
    return (
        f"servo {servo.servo_id}: its {volatile.name} is {limit}, but its {persistent.name} is {highest}, so the servo "
        "may not hold its load. Switch its supply off and on to restore its torque limit"
    )


def release(servo: FoundServo) -> None:
    """Disable the torque. If the servo is holding a load, the load falls."""
    servo.bus.torque_off([servo.servo_id])
    if servo.holds_torque():
        raise CommissioningError(f"servo {servo.servo_id}: its torque could not be disabled. Switch its supply off")


ELSEWHERE: Final = {
    "id": "change it with 'servoloop set-id'",
    "baud_rate": "change it with 'servoloop set-baud'",
    "protocol_type": "with another protocol the servo would no longer respond on this bus",
    "lock": "the tools open and close the lock themselves",
}
"""Registers that ``write_register`` does not write, with the reason or the command to use instead."""
GOALS: Final = ("goal_position", "goal_velocity", "goal_time", "goal_pwm", "goal_current", "moving_speed")
"""Registers that make the servo move. Writing to such a register also enables the torque of an STS servo."""
CORRECTS_S: Final = 0.005
"""Time to wait before reading back. An STS servo accepts any value, and corrects an invalid value 1 ms later."""


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """Result of a write. ``before`` and ``after`` are equal if the servo already had the value."""

    servo_id: int
    before: RegisterValue
    after: RegisterValue

    @property
    def changed(self) -> bool:
        """Whether the value changed."""
        return self.before.raw != self.after.raw


def list_registers(servo: FoundServo) -> tuple[RegisterValue, ...]:
    """Read all registers of the servo."""
    return tuple(value_of(servo.model, register, _held(servo, register)) for register in registers_of(servo.model))


def read_register(servo: FoundServo, name: str) -> RegisterValue:
    """Read one register. Raises CommissioningError, ServoError."""
    register = register_named(servo.model, name)
    return value_of(servo.model, register, servo.read(register))


def write_register(servo: FoundServo, name: str, value: str | int, *, torque: bool = False) -> RegisterWrite:
    """Write one register and read it back.

    An EEPROM register is unlocked for the write, and is written only if its value differs. Goal registers cannot be
    written. While torque is enabled, only ``torque_enable`` can be written: 1 makes the servo hold its position, and 0
    disables torque.

    Args:
        servo: The servo.
        name: Name of the register.
        value: Raw value, or a quantity with its unit, such as ``65C``.
        torque: Whether ``torque_enable`` may be written.

    Raises:
        CommissioningError: The value cannot be written.
    """
    register, raw = register_named(servo.model, name), value_to_write(servo, name, value)
    before = value_of(servo.model, register, servo.read(register))
    if register == servo.series.torque_enable:
        _switch(servo, raw, torque)
    elif raw != before.raw:
        if servo.holds_torque():
            raise CommissioningError(
                f"servo {servo.servo_id}: {name} cannot be written while the torque is enabled. Support the arm, "
                f"then disable the torque with 'servoloop register write --port {servo.port.name} --id "
                f"{servo.servo_id} torque_enable 0'"
            )
        _write(servo, register, raw)
    return RegisterWrite(servo.servo_id, before, value_of(servo.model, register, servo.read(register)))


def value_to_write(servo: FoundServo, name: str, value: str | int) -> int:
    """Return the raw value that ``write_register`` would write, without writing it. Raises CommissioningError."""
    register = register_named(servo.model, name)
    raw = parse(servo.model, register, str(value))
    check_writable(servo, register, raw)
    return raw


def check_writable(servo: FoundServo, register: Register, raw: int) -> None:
    """Raise CommissioningError if this value should not be written manually."""
    name = register.name
    text = ""
    if register.access is Access.READ:
        text = "is read-only"
    elif name in ELSEWHERE:
        text = f"cannot be written here: {ELSEWHERE[name]}"
    elif name in GOALS:
        text = (
            "cannot be written here, because it makes the servo move and can even enable its torque. Use "
            "'servoloop up' to move an arm"
        )
    elif register == servo.series.status_level and raw == 0:
        text = "must not be 0, because the servo would no longer respond"
    elif register == servo.series.torque_enable and raw not in (0, 1):
        text = f"must be 0 (off) or 1 (on), not {raw}: other values move the servo's zero or brake its motor"
    if text:
        raise CommissioningError(f"servo {servo.servo_id}: {name} {text}")


def _switch(servo: FoundServo, raw: int, torque: bool) -> None:
    if not torque:
        raise CommissioningError(f"servo {servo.servo_id}: its torque is changed only if you confirm with --yes")
    if raw:
        enable_torque_in_place(servo)
    else:
        release(servo)


def _write(servo: FoundServo, register: Register, raw: int) -> None:
    servo_id, series = servo.servo_id, servo.series
    if register.persistent:
        try:
            update(servo.bus, servo_id, series.lock, {register: raw})
        except ValueError as error:
            raise CommissioningError(f"servo {servo_id}: {error}") from error
        return
    write_ram(servo, register, raw)


def write_ram(servo: FoundServo, register: Register, raw: int) -> None:
    """Write a register without unlocking EEPROM, and read it back.

    Raises CommissioningError if the servo does not keep the value.
    """
    servo_id = servo.servo_id
    retry_often(partial(servo.bus.write, servo_id, register, raw))
    servo.clock.sleep_until(servo.clock.now() + CORRECTS_S)
    if (held := servo.read(register)) != raw:
        raise CommissioningError(
            f"servo {servo_id}: {register.name} is still {held}, because the servo does not accept the value {raw}"
        )


def _held(servo: FoundServo, register: Register) -> int | None:
    try:
        return servo.read(register)
    except ServoRefused:  # This firmware does not have the register.
        return None
