"""Write the EEPROM settings of one servo, and check them again after a restart."""

from collections.abc import Mapping
from functools import partial
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.eeprom import Change, add_notes, update
from drivers.servos.catalog import registers_of, series_of
from drivers.servos.register import Register, ServoModel

RESTART_S: Final = 1.5
"""Time allowed for the restart of a servo, in seconds. A servo needs 0.8 s."""


def persistent_registers(model: ServoModel) -> dict[str, Register]:
    """Return the EEPROM registers of this model, keyed by name and sorted by address."""
    return {register.name: register for register in registers_of(model) if register.persistent}


def provision(
    bus: Bus, clock: Clock, servo_id: int, model: ServoModel, values: Mapping[Register, int]
) -> tuple[Change, ...]:
    """Write register values to the servo's EEPROM and return the changes. The ID is written last.

    Torque must be off, and only registers whose values differ are written. After a change, the servo is restarted,
    because some registers take effect only after a restart, and all values are read back. Raises ServoError,
    CommissioningError or PortLost, with the changes made so far in the notes of the exception.
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
    """Restart a servo whose torque is off, and wait until it responds. Do nothing if the protocol has no restart
    instruction."""
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
        raise CommissioningError(
            f"servo {servo_id} lost values that were written: after its restart, {'; '.join(lost)}. Write them again; "
            "if that does not help, replace the servo"
        )


def drives(bus: Bus, servo_id: int, model: ServoModel) -> bool:
    """Return whether the servo drives its motor in any way, including damping."""
    return retry(partial(bus.read, servo_id, series_of(model).torque_enable)) != 0
