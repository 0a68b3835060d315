"""Factory reset and reboot of one servo: done only when it is limp, and it is looked for afterwards."""

from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from commissioning.errors import CommissioningError
from commissioning.registers.tables import registers_of
from commissioning.registers.values import RegisterValue, value_of
from commissioning.scan.find import FoundServo, answers, locate
from drivers.errors import ServoSilent
from drivers.servos.dynamixel1 import PROTOCOL_1

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
