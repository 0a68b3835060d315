"""The line that a verb works on: which port, and the bus opened on it."""

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Annotated

import typer
from serial.tools.list_ports import comports

from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from drivers.port.serial_port import SerialPort
from drivers.servos.register import ServoModel

PortOption = Annotated[str | None, typer.Option("--port", help="Serial device; by default the only USB adapter.")]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before writing.")]


@contextmanager
def open_line(port: str | None, baud: int, models: Mapping[int, ServoModel]) -> Iterator[Bus]:
    """A bus on this port, or on that of the only USB adapter. Raises DriverError."""
    clock = MonotonicClock()
    with closing(Bus(SerialPort(port or only_adapter(), baud, clock), clock, models)) as bus:
        yield bus


def only_adapter() -> str:
    """The device of the only USB adapter. Raises DriverError where there is none, or several."""
    devices = [one.device for one in comports() if one.vid is not None]
    if len(devices) != 1:
        raise DriverError(f"there are {len(devices)} USB adapters ({', '.join(devices) or 'none'}): name one: --port")
    return devices[0]


def adapter_serial(device: str) -> str | None:
    """The serial number of the USB adapter behind a device; None where it has none."""
    path = Path(device).resolve()
    return next((one.serial_number for one in comports() if Path(one.device).resolve() == path), None)
