"""The line that a verb works on: which port, and the bus opened on it."""

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Annotated

import typer
from serial.tools.list_ports import comports

from commissioning.ports.adapters import only_port
from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.port.serial_port import SerialPort
from drivers.servos.register import ServoModel

PortOption = Annotated[str | None, typer.Option("--port", help="Serial device; by default the only USB adapter.")]


@contextmanager
def open_line(port: str | None, baud: int, models: Mapping[int, ServoModel]) -> Iterator[Bus]:
    """A bus on this port, or on that of the only USB adapter. Raises DriverError."""
    clock = MonotonicClock()
    with closing(Bus(SerialPort(port or only_port(), baud, clock), clock, models)) as bus:
        yield bus


def adapter_serial(device: str) -> str | None:
    """The serial number of the USB adapter behind a device; None where it has none."""
    path = Path(device).resolve()
    return next((one.serial_number for one in comports() if Path(one.device).resolve() == path), None)
