"""A servo at another rate is brought to that of its line."""

from contextlib import suppress
from functools import partial

from calibration.eeprom import CLOSED, OPEN, eeprom
from commissioning.provision import persistent_registers, restart
from commissioning.registers.tables import rates_of
from commissioning.set_up.place import SetUpError
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.errors import ServoError
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel


def bring_to_rate(bus: Bus, clock: Clock, servo_id: int, model: ServoModel, rate: int) -> None:
    """Make a limp servo that answers at ``rate`` answer at the line's; it is alone on the line.

    However it ends, its EEPROM is locked. Raises SetUpError, ServoError, PortLost.
    """
    series = series_of(model)
    values = {baud: value for value, baud in rates_of(model).items()}
    if bus.baud not in values:
        raise SetUpError(f"servo {servo_id} answers at {rate} baud, and a {model.name} cannot be set to {bus.baud}")
    register, value = persistent_registers(model)["baud_rate"], values[bus.baud]
    try:
        with bus.at_baud(rate) as other:
            _write(other, servo_id, series.lock, register, value)
        _check(bus, servo_id, register, value)
    finally:
        _lock(bus, servo_id, series.lock, rate)
    restart(bus, clock, servo_id, model)


def _write(bus: Bus, servo_id: int, lock: Register | None, register: Register, value: int) -> None:
    if lock is not None:
        retry(partial(bus.write, servo_id, lock, OPEN))
    # Its answer comes at the old rate or not at all: it is looked for at the new one.
    with suppress(ServoError):
        bus.write(servo_id, register, value)


def _check(bus: Bus, servo_id: int, register: Register, value: int) -> None:
    try:
        held = retry(partial(bus.read, servo_id, register))
    except ServoError as error:
        raise SetUpError(f"servo {servo_id} did not come to {bus.baud} baud: {error.text}") from error
    if held != value:
        raise SetUpError(f"servo {servo_id}: {register.name} stays {held}, not {value}")


def _lock(bus: Bus, servo_id: int, lock: Register | None, rate: int) -> None:
    """Close the lock at whichever rate the servo answers now."""
    if lock is None:
        return
    try:
        retry(partial(bus.write, servo_id, lock, CLOSED))
    except ServoError:
        with suppress(ServoError), bus.at_baud(rate) as other, eeprom(other, servo_id, lock):
            pass
