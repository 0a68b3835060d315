"""Options that select a serial port, a servo or a baud rate, and functions that open the selected bus."""

import signal
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.commissioning_errors import LARGEST_BAUD, SMALLEST_BAUD
from drivers.paths import resolved
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import end_signals

if TYPE_CHECKING:
    from commissioning.scan.find import FoundServo
    from drivers.bus.bus import Bus
    from drivers.servos.register import ServoModel
    from hal.robot_file.robot_file import RobotFile
    from servoloop.stack.robot_files import ServoFiles

PortOption = Annotated[str | None, typer.Option("--port", help="Serial port (default: the only adapter).")]
PortsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--port",
        help="Serial port (default: the only adapter); NAME=PATH for each of several buses; `virtual` for virtual "
        "servos.",
    ),
]
BaudOption = Annotated[
    int | None,
    typer.Option("--baud", min=SMALLEST_BAUD, max=LARGEST_BAUD, help="Baud rate (default: all rates are tried)."),
]
IdOption = Annotated[int, typer.Option("--id", min=0, max=253, help="ID of the servo.")]
IdArgument = Annotated[int, typer.Argument(min=0, max=253, help="ID of the servo.")]


@contextmanager
def interruptible() -> Iterator[None]:
    """Let SIGTERM and SIGHUP interrupt the block like Ctrl-C, so that EEPROMs are locked and torque is disabled.

    Raises Interrupted after a signal. The error message describes what could not be restored.
    """
    former = {number: signal.signal(number, _interrupt) for number in end_signals() if number != signal.SIGINT}
    try:
        yield
    except KeyboardInterrupt as error:
        left = "".join(f"; {note}" for note in _left(error))
        raise Interrupted(f"interrupted; the port is closed{left}") from None
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def _left(error: BaseException | None) -> Iterator[str]:
    """Yield the notes attached to an error and to the errors in its context, such as those of a first Ctrl-C."""
    while error is not None:
        yield from getattr(error, "__notes__", ())
        error = error.__context__


def _interrupt(number: int, frame: FrameType | None) -> None:
    # The kernel and the shell both send SIGHUP; the second signal must not interrupt the cleanup.
    if number == signal.SIGHUP:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    raise KeyboardInterrupt


def device_of(port: str | None, bus: str | None = None) -> str:
    """Return the path of the only selected port, given as PATH or NAME=PATH, or of the only USB adapter.

    Raises CommissioningError if there is not exactly one adapter, or if NAME is not the selected bus.
    """
    from commissioning.commissioning_errors import CommissioningError
    from commissioning.ports.adapters import only_port

    if port is None:
        return only_port()
    name, _, path = port.partition("=")
    if not path or "/" in name:
        return port
    if bus not in (None, name):
        raise CommissioningError(f"--port {port} is the port of the bus {name}, but --bus is {bus}: use the same bus")
    return path


@contextmanager
def servo_at(port: str | None, servo_id: int, baud: int | None) -> Iterator["FoundServo"]:
    """Open the port and find a servo while the block runs. Signals can interrupt the block."""
    from commissioning.scan.find import find_servo
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort

    clock = MonotonicClock()
    line = SerialPort(device_of(port), baud or 1_000_000, clock)
    try:
        with interruptible(), find_servo(line, clock, servo_id, (baud,) if baud else ()) as servo:
            yield servo
    finally:
        line.close()


@contextmanager
def open_line(device: str, baud: int, models: "Mapping[int, ServoModel]") -> "Iterator[Bus]":
    """Open a bus on a serial device. Raises DriverError."""
    from drivers.bus.bus import Bus
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort

    clock = MonotonicClock()
    with closing(Bus(SerialPort(device, baud, clock), clock, models)) as bus:
        yield bus


def bus_of(robot: "RobotFile", name: str | None) -> str:
    """Return the name of the selected bus in a robot file, or of its only bus. Raises CommissioningError."""
    from commissioning.commissioning_errors import CommissioningError

    names = list(robot.lines())
    if name is None and len(names) == 1:
        return names[0]
    if name in names:
        return name
    if len(names) == 1:
        raise CommissioningError(f"the robot file has only one bus, which is not named {name}; omit --bus")
    raise CommissioningError(f"the robot file has several buses; choose one with --bus {' or '.join(names)}")


@contextmanager
def served_devices(ports: list[str] | None, files: "ServoFiles") -> Iterator[dict[str, str]]:
    """Yield the serial device of each bus, as selected by ``--port``.

    If none is selected, the only connected adapter is used. With ``virtual``, a child process serves virtual servos
    until the block ends. Raises DriverError.
    """
    from commissioning.commissioning_errors import CommissioningError
    from commissioning.ports.adapters import only_port
    from servoloop.stack.devices import VIRTUAL, parse_ports
    from servoloop.stack.emulator_process import virtual_servos

    buses = list(files.robot.file.lines())
    if not ports and len(buses) > 1:
        raise CommissioningError(f"the robot has the buses {', '.join(buses)}; pass --port NAME=PATH for each of them")
    try:
        devices = parse_ports(ports or [only_port()], buses)
    except CommissioningError as error:
        raise CommissioningError(f"{error}; for virtual servos, use --port {VIRTUAL}") from error
    if devices is not None:
        yield devices
        return
    with virtual_servos(files) as served:
        typer.echo(f"virtual servos at {' and '.join(served.values())}", err=True)
        yield served


def named_devices(ports: list[str], buses: Iterable[str], arm: str) -> dict[str, str]:
    """Return the device of each bus for an arm that a person moves by hand.

    Virtual servos in a child process cannot be moved by hand, so ``virtual`` is rejected. ``arm`` is the arm's name as
    given on the command line. Raises DriverError.
    """
    from drivers.driver_errors import DriverError
    from servoloop.stack.devices import parse_ports

    devices = parse_ports(ports, buses)
    if devices is None:
        raise DriverError(
            f"{' '.join(ports)!r} is not a serial port; for virtual servos that can be moved by hand, run "
            f"`servoloop emulate LINK --arm {arm}` and pass LINK as the port"
        )
    return devices


def require_ports(devices: Mapping[str, str], robot: "RobotFile") -> None:
    """Raise PortError if the device of a bus cannot be opened. Call this function before a question about the arm."""
    from drivers.port.serial_port import require_port

    for bus, device in devices.items():
        require_port(device, robot.lines()[bus].baud)


def adapter_serial(device: str) -> str | None:
    """Return the serial number of a device's USB adapter, or None if it has no serial number."""
    from serial.tools.list_ports import comports

    path = resolved(device)
    return next((one.serial_number for one in comports() if resolved(one.device) == path), None)
