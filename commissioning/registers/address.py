"""A servo's ID and its baud rate: each refused where it would leave two servos that cannot be told apart."""

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from calibration.eeprom import Change, Eeprom, EepromError, eeprom, update
from commissioning.errors import CommissioningError
from commissioning.registers.tables import rates_of, register_named, registers_of
from commissioning.registers.values import RegisterValue, value_of
from commissioning.scan.find import FoundServo, answers, locate
from commissioning.scan.identify import surely
from drivers.errors import PortLost, ServoError, ServoSilent
from drivers.protocol import v2
from drivers.servos.dynamixel1 import PROTOCOL_1
from drivers.servos.register import Register


@dataclass(frozen=True, slots=True)
class IdChange:
    """The servo's ID before and after, and the rate at which it answers."""

    old_id: int
    new_id: int
    baud: int


@dataclass(frozen=True, slots=True)
class BaudChange:
    """The servo's rate before and after."""

    servo_id: int
    old_baud: int
    new_baud: int


def set_id(servo: FoundServo, new_id: int) -> IdChange:
    """Give the servo another ID and see that it answers to that. Raises where another servo has it already.

    EEPROM is written under its lock, read back and locked again.
    """
    largest = v2.LARGEST_ID if servo.packets is v2 else 253
    if not 0 <= new_id <= largest:
        raise CommissioningError(f"servo {servo.servo_id}: its ID can be 0 to {largest}, not {new_id}")
    update(servo.bus, servo.servo_id, servo.series.lock, {servo.series.servo_id: new_id})
    if new_id != servo.servo_id and answers(servo.port, servo.clock, servo.packets, servo.servo_id):
        raise CommissioningError(
            f"servo {servo.servo_id}: has become {new_id}, and another answers to {servo.servo_id}: there were two"
        )
    return IdChange(servo.servo_id, new_id, servo.port.baud)


def set_baud(servo: FoundServo, baud: int) -> BaudChange:
    """Give the servo another rate and see that it answers there; the port is at that rate then.

    Raises CommissioningError where the servo or the adapter does not know the rate, or somebody with its ID is there.
    """
    register = register_named(servo.model, "baud_rate")
    values = {rate: value for value, rate in rates_of(servo.model).items()}
    if baud not in values:
        known = ", ".join(str(rate) for rate in sorted(values))
        raise CommissioningError(f"servo {servo.servo_id}: {servo.name} knows {known} baud, not {baud}")
    former = servo.port.baud
    if baud == former:
        return BaudChange(servo.servo_id, former, baud)
    _refuse_taken(servo, former, baud)
    old = servo.read(register)
    with eeprom(servo.bus, servo.servo_id, servo.series.lock) as memory:
        try:
            memory.write_unread(register, values[baud])
            found = _follow(servo, memory, register, (baud, former))
        except PortLost:
            raise
        except BaseException:  # it can be locked only at the rate at which it is
            _follow(servo, memory, register, (former, baud))
            raise
        _check_arrived(servo, register, found, former, baud)
        memory.changes.append(Change(register, old, values[baud]))
    return BaudChange(servo.servo_id, former, baud)


def _refuse_taken(servo: FoundServo, former: int, baud: int) -> None:
    """Where the adapter cannot make the rate this raises PortError: nothing is written then."""
    try:
        servo.port.set_baud(baud)
        taken = answers(servo.port, servo.clock, servo.packets, servo.servo_id)
    finally:
        servo.port.set_baud(former)
    if taken:
        raise CommissioningError(
            f"servo {servo.servo_id}: another servo with this ID answers at {baud} baud: give one of them another first"
        )


def _follow(servo: FoundServo, memory: Eeprom, register: Register, rates: tuple[int, int]) -> int | None:
    """Go on at that of these rates at which the servo answers, and say which it is."""
    for rate in rates:
        servo.port.set_baud(rate)
        memory.bus = servo.bus
        with suppress(ServoError):
            surely(partial(memory.bus.read, servo.servo_id, register))
            return rate
    return None


def _check_arrived(servo: FoundServo, register: Register, found: int | None, former: int, baud: int) -> None:
    if found is None:
        raise EepromError(servo.servo_id, register, f"was to become {baud} baud: it answers neither so nor at {former}")
    if found != baud:
        raise EepromError(servo.servo_id, register, f"stays at {former} baud: the servo does not take {baud}")


RESTART_S: Final = 1.0
"""Feetech and ROBOTIS give less for a reboot."""
DEAF_S: Final = 0.05
"""Before that it may not have begun."""
PATIENCE_S: Final = 4.0
FACTORY_ID: Final = 1
"""Which a servo of Dynamixel protocol 1.0 gets; all others keep theirs."""


@dataclass(frozen=True, slots=True)
class ResetReport:
    """Where the servo answers after the reset, and the settings that it lost: before and after."""

    servo_id: int
    baud: int
    old_id: int
    old_baud: int
    changes: tuple[tuple[RegisterValue, RegisterValue], ...]


@dataclass(frozen=True, slots=True)
class RebootReport:
    """``took_s``: until it answered again. ``let_go``: whether it held torque before; it does not afterwards."""

    servo_id: int
    took_s: float
    let_go: bool


def factory_reset(servo: FoundServo) -> ResetReport:
    """Give the servo its factory's settings; the port is then at the rate at which it answers.

    Raises CommissioningError where it holds torque, or would get an ID that another servo has.
    """
    _refuse_torque(servo, "is not reset")
    goes_to = FACTORY_ID if servo.series.protocol is PROTOCOL_1 else servo.servo_id
    if goes_to != servo.servo_id and answers(servo.port, servo.clock, servo.packets, goes_to):
        raise CommissioningError(
            f"servo {servo.servo_id}: gets ID {goes_to} by a reset, and another servo has that: unplug it first"
        )
    before, old_baud = _settings(servo), servo.port.baud
    with suppress(ServoSilent):  # its answer may be what got lost: it is looked for anyway
        servo.bus.factory_reset(servo.servo_id)
    servo.clock.sleep_until(servo.clock.now() + RESTART_S)
    after = _located(servo, goes_to)
    changes = tuple((was, now) for was, now in zip(before, _settings(after), strict=True) if was.raw != now.raw)
    return ResetReport(after.servo_id, servo.port.baud, servo.servo_id, old_baud, changes)


def reboot(servo: FoundServo, *, let_go: bool = False) -> RebootReport:
    """Restart the servo's firmware and wait until it answers again. ``let_go``: also where it holds torque."""
    held = servo.holds_torque()
    if held and not let_go:
        _refuse_torque(servo, "is not rebooted")
    began_s = servo.clock.now()
    servo.bus.reboot(servo.servo_id)
    servo.clock.sleep_until(began_s + DEAF_S)
    while servo.clock.now() < began_s + PATIENCE_S:
        if answers(servo.port, servo.clock, servo.packets, servo.servo_id):
            return RebootReport(servo.servo_id, round(servo.clock.now() - began_s, 3), held)
    raise CommissioningError(f"servo {servo.servo_id}: does not come back after a reboot: switch its supply off and on")


def _refuse_torque(servo: FoundServo, what: str) -> None:
    if servo.holds_torque():
        raise CommissioningError(
            f"servo {servo.servo_id}: {what} while it holds torque: it would release, and what it holds falls. "
            f"Support the arm, then 'servoloop register write --id {servo.servo_id} torque_enable 0'"
        )


def _located(servo: FoundServo, goes_to: int) -> FoundServo:
    """Where it went; by the manuals to ``goes_to``, but not every clone has read them."""
    try:
        return locate(servo.port, servo.clock, goes_to)
    except CommissioningError:
        if goes_to == servo.servo_id:
            raise
        return locate(servo.port, servo.clock, servo.servo_id)


def _settings(servo: FoundServo) -> list[RegisterValue]:
    lasting = [register for register in registers_of(servo.model) if register.persistent]
    return [value_of(servo.model, register, servo.read(register)) for register in lasting]
