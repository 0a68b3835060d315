"""The line that a verb works on: the options that say which, and the bus or the one servo on it."""

import signal
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.errors import LARGEST_BAUD, SMALLEST_BAUD
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import end_signals

if TYPE_CHECKING:
    from commissioning.scan.find import FoundServo
    from drivers.bus.bus import Bus
    from drivers.servos.register import ServoModel
    from hal.robot_file.robot_file import RobotFile
    from servoloop.stack.robot_files import ServoFiles

PortOption = Annotated[str | None, typer.Option("--port", help="Serial device; without it the only adapter there is.")]
PortsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--port",
        help="Serial device; NAME=PATH for each of several buses; `virtual`: virtual servos. "
        "Without: the only adapter there is.",
    ),
]
BaudOption = Annotated[
    int | None,
    typer.Option("--baud", min=SMALLEST_BAUD, max=LARGEST_BAUD, help="Only at this rate; without it all are tried."),
]
IdOption = Annotated[int, typer.Option("--id", min=0, max=253, help="The servo's ID.")]
IdArgument = Annotated[int, typer.Argument(min=0, max=253, help="The servo's ID.")]


@contextmanager
def interruptible() -> Iterator[None]:
    """SIGTERM and SIGHUP end the block as Ctrl-C does: on the way out an open EEPROM is locked, and torque taken back.

    Raises Interrupted then, with what may be left behind.
    """
    former = {number: signal.signal(number, _interrupt) for number in end_signals() if number != signal.SIGINT}
    try:
        yield
    except KeyboardInterrupt as error:
        left = "".join(f"; {note}" for note in _left(error))
        raise Interrupted(f"interrupted, and the port closed{left}") from None
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def _left(error: BaseException | None) -> Iterator[str]:
    """What is said beside an error, and beside those whose place it took: a second Ctrl-C that of the first."""
    while error is not None:
        yield from getattr(error, "__notes__", ())
        error = error.__context__


def _interrupt(number: int, frame: FrameType | None) -> None:
    if number == signal.SIGHUP:  # the kernel and the shell each send one: a second must not interrupt the ending
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    raise KeyboardInterrupt


@contextmanager
def servo_at(port: str | None, servo_id: int, baud: int | None) -> Iterator["FoundServo"]:
    """The servo, its port opened for as long as the block lasts; interruptible."""
    from commissioning.ports.adapters import only_port
    from commissioning.scan.find import find_servo
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort

    clock = MonotonicClock()
    line = SerialPort(port or only_port(), baud or 1_000_000, clock)
    try:
        with interruptible(), find_servo(line, clock, servo_id, (baud,) if baud else ()) as servo:
            yield servo
    finally:
        line.close()


@contextmanager
def open_line(port: str | None, baud: int, models: "Mapping[int, ServoModel]") -> "Iterator[Bus]":
    """A bus on this port, or on that of the only USB adapter. Raises DriverError."""
    from commissioning.ports.adapters import only_port
    from drivers.bus.bus import Bus
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort

    clock = MonotonicClock()
    with closing(Bus(SerialPort(port or only_port(), baud, clock), clock, models)) as bus:
        yield bus


def bus_of(robot: "RobotFile", said: str | None) -> str:
    """The bus of a robot file that is meant: the one that is said, or the only one. Raises CommissioningError."""
    from commissioning.errors import CommissioningError

    names = list(robot.lines())
    if said is None and len(names) == 1:
        return names[0]
    if said in names:
        return said
    if len(names) == 1:
        raise CommissioningError(f"the robot file has one bus, and none with the name {said}: leave out --bus")
    raise CommissioningError(f"the robot file has several buses, and this is for one: say --bus {' or '.join(names)}")


@contextmanager
def served_devices(said: list[str] | None, files: "ServoFiles") -> Iterator[dict[str, str]]:
    """The device of each bus: those of ``--port``, the only adapter, or with ``virtual`` those of virtual servos.

    Virtual servos are served by a child process until the end of the block. Raises DriverError.
    """
    from commissioning.errors import CommissioningError
    from commissioning.ports.adapters import only_port
    from servoloop.stack.devices import VIRTUAL, parse_ports
    from servoloop.stack.emulator_process import virtual_servos

    buses = list(files.robot.file.lines())
    if not said and len(buses) > 1:
        raise CommissioningError(f"the robot has the buses {', '.join(buses)}: name a --port NAME=PATH for each")
    try:
        devices = parse_ports(said or [only_port()], buses)
    except CommissioningError as error:
        raise CommissioningError(f"{error}; --port {VIRTUAL} is for virtual servos") from error
    if devices is not None:
        yield devices
        return
    with virtual_servos(files) as served:
        typer.echo(f"virtual servos at {' and '.join(served.values())}", err=True)
        yield served


def named_devices(said: list[str], buses: Iterable[str], arm: str) -> dict[str, str]:
    """The device of each bus of an arm that is moved by hand, which virtual servos of a child process cannot be.

    ``arm``: as it was named on the command line. Raises DriverError.
    """
    from drivers.errors import DriverError
    from servoloop.stack.devices import parse_ports

    devices = parse_ports(said, buses)
    if devices is None:
        raise DriverError(
            f"{' '.join(said)!r} is not a device: serve virtual servos that a hand can move with "
            f"`servoloop emulate LINK --arm {arm}`, and name LINK"
        )
    return devices


def adapter_serial(device: str) -> str | None:
    """The serial number of the USB adapter behind a device; None where it has none."""
    from serial.tools.list_ports import comports

    path = Path(device).resolve()
    return next((one.serial_number for one in comports() if Path(one.device).resolve() == path), None)
