"""Make a servo that responds only to pings reply to reads again. The servo does not acknowledge the write that does
this."""

from functools import partial
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.access import CORRECTS_S
from commissioning.scan.find import answering_step
from commissioning.scan.identify import retry_often
from commissioning.scan.steps import steps
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import PortLost, ServoError
from drivers.port import Port
from drivers.servos.catalog import known_as, series_of
from drivers.servos.register import ServoModel

BURN_S: Final = 0.05
"""Time allowed for a servo to write its EEPROM, in seconds."""


def answer_reads(port: Port, clock: Clock, servo_id: int, model: ServoModel, bauds: tuple[int, ...] = ()) -> int:
    """Set the servo's status level so that it replies to all instructions. The port stays at the servo's baud rate.

    Args:
        port: The port.
        clock: Clock for all delays and timeouts.
        servo_id: ID of the servo.
        model: Model of the servo, which cannot be read. Other models may have a different register at the same address.
        bauds: Baud rates to try. If empty, try all baud rates.

    Returns:
        The servo's new status level.

    Raises:
        CommissioningError: The servo does not respond, already replies to reads, does not reply to reads after the
            write, or has a different model.
    """
    series = series_of(model)
    packets, level = series.protocol.packets, series.status_level
    _find(port, clock, servo_id, model, bauds)
    _refuse_readable(port, clock, servo_id, model)
    data = packets.place(level.address) + level.encode(series.answers_all, series.protocol.byte_order)
    port.write(packets.packet(servo_id, packets.WRITE, data))
    clock.sleep_until(clock.now() + BURN_S + CORRECTS_S)
    port.discard_input()
    bus = Bus(port, clock, {servo_id: model})
    try:
        number = retry_often(partial(bus.read, servo_id, series.model_number))
    except PortLost:
        raise
    except ServoError as error:
        raise CommissioningError(
            f"servo {servo_id} still responds to pings but not to reads. Check that it is an {model.name}, switch its "
            "supply off and on, and try again"
        ) from error
    if number != model.number:
        raise CommissioningError(
            f"servo {servo_id} is model {number} ({known_as(number, series)}), not {model.name} ({model.number}). "
            f"Check its register {level.address}: the value {series.answers_all} was written to this register"
        )
    return retry_often(partial(bus.read, servo_id, level))


def _refuse_readable(port: Port, clock: Clock, servo_id: int, model: ServoModel) -> None:
    """Raise CommissioningError if the servo replies to reads. In this case, its model can be read instead of
    assumed."""
    series = series_of(model)
    try:
        number = retry_often(partial(Bus(port, clock, {servo_id: model}).read, servo_id, series.model_number))
    except PortLost:
        raise
    except ServoError:
        return
    raise CommissioningError(
        f"servo {servo_id} responds to reads (model number {number}), so nothing was written. Omit --model"
    )


def _find(port: Port, clock: Clock, servo_id: int, model: ServoModel, bauds: tuple[int, ...]) -> None:
    """Set the port to the baud rate at which the servo responds to pings."""
    series = series_of(model)
    tried = (step for step in steps((series.make,), bauds) if step.packets is series.protocol.packets)
    if answering_step(port, clock, servo_id, tried) is None:
        raise CommissioningError(
            f"no servo with ID {servo_id} responds to pings. Check its power, its cable and its ID"
        )
