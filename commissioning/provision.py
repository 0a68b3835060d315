"""Provisioning: one servo's EEPROM is made what it is to be, and checked again behind a restart."""

from collections.abc import Mapping
from functools import partial
from typing import Final

from calibration.eeprom import Change, add_notes, update
from commissioning.errors import CommissioningError
from commissioning.registers.tables import registers_of
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel

RESTART_S: Final = 1.5
"""A servo needs 0.8 s to come up again."""


def persistent_registers(model: ServoModel) -> dict[str, Register]:
    """The registers in this model's EEPROM by name, by address."""
    return {register.name: register for register in registers_of(model) if register.persistent}


def provision(
    bus: Bus, clock: Clock, servo_id: int, model: ServoModel, values: Mapping[Register, int]
) -> tuple[Change, ...]:
    """Make the servo hold ``values``; what had to be changed. The ID comes last.

    Only what differs is written, behind the lock, and not under torque. A servo to which anything was written is
    restarted, for some registers count only from then on, and asked whether it holds all still. Raises ServoError,
    CommissioningError, PortLost; what had been changed is in the exception's notes.
    """
    changes = update(bus, servo_id, series_of(model).lock, values)
    if changes:
        new_id = next((change.new for change in changes if change.register.name == "id"), servo_id)
        try:
            restart(bus, clock, new_id, model)
            _check(bus, new_id, values)
        except BaseException as error:
            add_notes(error, changes)
            raise
    return changes


def restart(bus: Bus, clock: Clock, servo_id: int, model: ServoModel) -> None:
    """Restart a limp servo, where its protocol can, and wait until it answers again."""
    if series_of(model).protocol.reboot == "none":
        return
    bus.reboot(servo_id)
    clock.sleep_until(clock.now() + RESTART_S)
    retry(partial(bus.ping, servo_id))


def _check(bus: Bus, servo_id: int, values: Mapping[Register, int]) -> None:
    held = {register: retry(partial(bus.read, servo_id, register)) for register in values}
    lost = [f"{register.name} is {held[register]}, not {value}" for register, value in values.items()
            if held[register] != value]  # fmt: skip
    if lost:
        raise CommissioningError(f"servo {servo_id} has not kept what was written: {'; '.join(lost)} after its restart")


def drives(bus: Bus, servo_id: int, model: ServoModel) -> bool:
    """Whether the servo does anything with its motor, damping too."""
    return retry(partial(bus.read, servo_id, series_of(model).torque_enable)) != 0
