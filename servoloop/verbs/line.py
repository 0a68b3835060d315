"""The options by which a verb is told which servo, and the servo they mean."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.processes import Interrupted

if TYPE_CHECKING:
    from commissioning.scan.find import FoundServo

PortOption = Annotated[str | None, typer.Option("--port", help="Serial device; without it the only adapter there is.")]
BaudOption = Annotated[int | None, typer.Option("--baud", min=1, help="Only at this rate; without it all are tried.")]
IdOption = Annotated[int, typer.Option("--id", min=0, max=253, help="The servo's ID.")]
IdArgument = Annotated[int, typer.Argument(min=0, max=253, help="The servo's ID.")]


@contextmanager
def servo_at(port: str | None, servo_id: int, baud: int | None) -> Iterator["FoundServo"]:
    """The servo, its port opened for as long as the block lasts.

    SIGTERM ends the block as Ctrl-C does, so that an open EEPROM is locked on the way out.
    """
    from commissioning.ports.adapters import only_port
    from commissioning.scan.find import find_servo
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort

    clock = MonotonicClock()
    line = SerialPort(port or only_port(), baud or 1_000_000, clock)
    former = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with find_servo(line, clock, servo_id, (baud,) if baud else ()) as servo:
            yield servo
    except KeyboardInterrupt as error:
        left = "".join(f"; {note}" for note in getattr(error, "__notes__", ()))
        raise Interrupted(f"interrupted, and the port closed{left}") from None
    finally:
        signal.signal(signal.SIGTERM, former)
        line.close()
