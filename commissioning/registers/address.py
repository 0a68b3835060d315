"""Change the ID or the baud rate of a servo, reset it to factory settings, or restart it.

A change that would give two servos the same ID at the same baud rate is rejected.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.tables import rates_of, register_named
from commissioning.registers.values import RegisterValue, value_of
from commissioning.scan.find import FoundServo, answers, locate
from commissioning.scan.identify import retry_often
from drivers.driver_errors import PortLost, ServoError, ServoSilent
from drivers.eeprom import Change, Eeprom, EepromError, eeprom, update
from drivers.protocol import v2
from drivers.servos.catalog import registers_of
from drivers.servos.dynamixel1 import PROTOCOL_1
from drivers.servos.register import Register


@dataclass(frozen=True, slots=True)
class IdChange:
    """ID of a servo before and after a change, and its baud rate."""

    old_id: int
    new_id: int
    baud: int


@dataclass(frozen=True, slots=True)
class BaudChange:
    """Baud rate of a servo before and after a change."""

    servo_id: int
    old_baud: int
    new_baud: int


def set_id(servo: FoundServo, new_id: int) -> IdChange:
    """Give the servo a new ID and check that it responds with this ID. Raise an error if another servo already has this
    ID.

    The EEPROM is unlocked, written, read back and locked again.
    """
    largest = v2.LARGEST_ID if servo.packets is v2 else 253
    if not 0 <= new_id <= largest:
        raise CommissioningError(f"servo {servo.servo_id}: the new ID must be 0 to {largest}, not {new_id}")
    update(servo.bus, servo.servo_id, servo.series.lock, {servo.series.servo_id: new_id})
    if new_id != servo.servo_id and answers(servo.port, servo.clock, servo.packets, servo.servo_id):
        raise CommissioningError(
            f"servo {servo.servo_id}: one servo now has ID {new_id}, but another servo still responds to ID "
            f"{servo.servo_id}. Two servos had this ID: connect the other servo alone and give it its own ID"
        )
    return IdChange(servo.servo_id, new_id, servo.port.baud)


def set_baud(servo: FoundServo, baud: int, before_write: Callable[[], None] = lambda: None) -> BaudChange:
    """Give the servo a new baud rate and check that it responds at this rate. The port stays at the new rate.

    Args:
        servo: The servo.
        baud: New baud rate.
        before_write: Function that is called immediately before the baud rate is written, if it must be written.

    Raises:
        CommissioningError: The servo or the adapter does not support the rate, or another servo already has this ID and
            rate.
        EepromError: The torque of the servo is enabled, or the rate was not changed.
    """
    register = register_named(servo.model, "baud_rate")
    values = {rate: value for value, rate in rates_of(servo.model).items()}
    if baud not in values:
        known = ", ".join(str(rate) for rate in sorted(values))
        raise CommissioningError(
            f"servo {servo.servo_id}: {servo.name} does not support {baud} baud. Use one of {known}"
        )
    former = servo.port.baud
    if baud == former:
        return BaudChange(servo.servo_id, former, baud)
    _refuse_taken(servo, former, baud)
    old = servo.read(register)
    with eeprom(servo.bus, servo.servo_id, servo.series.lock) as memory:
        try:
            memory.unlock(register)
            before_write()
            memory.write_unread(register, values[baud])
            found = _follow(servo, memory, register, (baud, former))
        except PortLost:
            raise
        except BaseException:  # The servo can be locked only at the rate at which it responds.
            _follow(servo, memory, register, (former, baud))
            raise
        _check_arrived(servo, register, found, former, baud)
        memory.changes.append(Change(register, old, values[baud]))
    return BaudChange(servo.servo_id, former, baud)


def _refuse_taken(servo: FoundServo, former: int, baud: int) -> None:
    """Raise CommissioningError if another servo has this ID and rate, or PortError if the adapter rejects the rate."""
    try:
        servo.port.set_baud(baud)
        taken = answers(servo.port, servo.clock, servo.packets, servo.servo_id)
    finally:
        servo.port.set_baud(former)
    if taken:
        raise CommissioningError(
            f"servo {servo.servo_id}: another servo with this ID already responds at {baud} baud. Give one of them "
            "another ID first"
        )


def _follow(servo: FoundServo, memory: Eeprom, register: Register, rates: tuple[int, int]) -> int | None:
    """Set the port to the first of these rates at which the servo responds.

    Return the rate, or None if the servo is silent.
    """
    for rate in rates:
        servo.port.set_baud(rate)
        memory.bus = servo.bus
        with suppress(ServoError):
            retry_often(partial(memory.bus.read, servo.servo_id, register))
            return rate
    return None


def _check_arrived(servo: FoundServo, register: Register, found: int | None, former: int, baud: int) -> None:
    if found is None:
        text = (
            f"was changed from {former} to {baud} baud, but the servo no longer responds at either rate. Switch its "
            f"supply off and on, then search for the servo with 'servoloop scan {servo.port.name}'"
        )
        raise EepromError(servo.servo_id, register, text)
    if found != baud:
        raise EepromError(servo.servo_id, register, f"is still at {former} baud: the servo does not accept {baud} baud")


RESTART_S: Final = 1.0
"""Time allowed for the restart of a servo, in seconds. The maximum times specified by Feetech and ROBOTIS are shorter
than this."""
DEAF_S: Final = 0.05
"""Maximum time until a restart begins, in seconds."""
PATIENCE_S: Final = 4.0
"""Maximum duration of a restart, in seconds."""
FACTORY_ID: Final = 1
"""ID of a Dynamixel protocol 1.0 servo after a factory reset. All other servos keep their IDs."""


@dataclass(frozen=True, slots=True)
class ResetReport:
    """Result of a factory reset."""

    servo_id: int
    baud: int
    old_id: int
    old_baud: int
    changes: tuple[tuple[RegisterValue, RegisterValue], ...]
    """Changed settings, each with the value before and after."""


@dataclass(frozen=True, slots=True)
class RebootReport:
    """Result of a restart."""

    servo_id: int
    took_s: float
    """Time until the servo responded again, in seconds."""
    let_go: bool
    """Whether torque was enabled before the restart. Torque is disabled after a restart."""


def factory_reset(servo: FoundServo) -> ResetReport:
    """Reset the servo to its factory settings. The port is set to the servo's baud rate.

    Raises CommissioningError if torque is enabled, or if the reset would assign an ID that another servo already has.
    """
    _refuse_torque(servo, "cannot be reset")
    goes_to = FACTORY_ID if servo.series.protocol is PROTOCOL_1 else servo.servo_id
    if goes_to != servo.servo_id and answers(servo.port, servo.clock, servo.packets, goes_to):
        raise CommissioningError(
            f"servo {servo.servo_id}: a reset would give it ID {goes_to}, but another servo has this ID. Unplug the "
            "other servo first"
        )
    before, old_baud = _settings(servo), servo.port.baud
    with suppress(ServoSilent):  # The reply may be lost, but the servo is searched for in any case.
        servo.bus.factory_reset(servo.servo_id)
    servo.clock.sleep_until(servo.clock.now() + RESTART_S)
    after = _located(servo, goes_to)
    changes = tuple((was, now) for was, now in zip(before, _settings(after), strict=True) if was.raw != now.raw)
    return ResetReport(after.servo_id, servo.port.baud, servo.servo_id, old_baud, changes)


def reboot(servo: FoundServo, *, let_go: bool = False) -> RebootReport:
    """Restart the servo and wait until it responds again.

    Args:
        servo: The servo.
        let_go: Whether to restart a servo whose torque is enabled. The restart disables torque.

    Raises:
        CommissioningError: Torque is enabled and ``let_go`` is False, or the servo does not respond after the restart.
    """
    held = servo.holds_torque()
    if held and not let_go:
        _refuse_torque(servo, "cannot be restarted")
    began_s = servo.clock.now()
    servo.bus.reboot(servo.servo_id)
    servo.clock.sleep_until(began_s + DEAF_S)
    while servo.clock.now() < began_s + PATIENCE_S:
        if answers(servo.port, servo.clock, servo.packets, servo.servo_id):
            return RebootReport(servo.servo_id, round(servo.clock.now() - began_s, 3), held)
    raise CommissioningError(f"servo {servo.servo_id} does not respond after its restart. Switch its supply off and on")


def _refuse_torque(servo: FoundServo, what: str) -> None:
    if servo.holds_torque():
        raise CommissioningError(
            f"servo {servo.servo_id}: {what} while its torque is enabled, because its load falls when the torque is "
            "disabled. Support the arm, then disable the torque with 'servoloop register write "
            f"--port {servo.port.name} --id {servo.servo_id} torque_enable 0'"
        )


def _located(servo: FoundServo, goes_to: int) -> FoundServo:
    """Find the servo after its reset, at the ID that the manuals specify or, for some clones, at its old ID."""
    try:
        return locate(servo.port, servo.clock, goes_to)
    except CommissioningError:
        if goes_to == servo.servo_id:
            raise
        return locate(servo.port, servo.clock, servo.servo_id)


def _settings(servo: FoundServo) -> list[RegisterValue]:
    lasting = [register for register in registers_of(servo.model) if register.persistent]
    return [value_of(servo.model, register, servo.read(register)) for register in lasting]
