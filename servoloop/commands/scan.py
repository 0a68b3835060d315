"""``servoloop scan``: who is on a line, and what is wrong with whom."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.errors import LARGEST_BAUD, SMALLEST_BAUD
from drivers.printable import counted
from servoloop.commands.console import JsonOption, print_json, print_table
from servoloop.stack.processes import Interrupted

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from commissioning.scan.examine import ScannedServo
    from commissioning.scan.scan import Progress, ScanReport
    from drivers.servos.catalog import Make
    from drivers.servos.register import ServoModel


class MakeChoice(Enum):
    """A make as an option: typer takes no list of literals."""

    feetech = "feetech"
    dynamixel = "dynamixel"

    @property
    def make(self) -> "Make":
        """The make as the catalog has it."""
        return "feetech" if self is MakeChoice.feetech else "dynamixel"


def scan(
    port: Annotated[str | None, typer.Argument(help="Serial device; without it the only adapter there is.")] = None,
    baud: Annotated[
        list[int] | None,
        typer.Option(min=SMALLEST_BAUD, max=LARGEST_BAUD, help="Only this rate; may be given several times."),
    ] = None,
    ids: Annotated[str | None, typer.Option(help="Only these IDs, one by one, such as 1-6 or 1,2,5.")] = None,
    make: Annotated[
        list[MakeChoice] | None, typer.Option(help="Look for this make to the end; may be given several times.")
    ] = None,
    arm: Annotated[
        str | None, typer.Option(help="Only this arm's IDs, and whether each is the model that the arm has there.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Look for servos at all rates and of all makes, and say what is wrong with whom.

    It only pings and reads: torque and registers stay as they are. Once somebody has answered, servos of the other wire
    protocol are looked for only if --make says so. It ends with 1 where nobody was found or an ID is absent.
    Example: `servoloop scan /dev/ttyACM0`, `servoloop scan --ids 1-6 --baud 1000000`, `servoloop scan --arm so101`
    """
    from rich.console import Console

    from commissioning.ports.adapters import only_port
    from commissioning.scan.scan import scan as search
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort
    from servoloop.bench.bus import parse_ids

    servo_ids = parse_ids(ids) if ids else ()
    makes, models = [one.make for one in make or ()], _models(arm) if arm else None
    clock, device = MonotonicClock(), port or only_port()
    line = SerialPort(device, (baud or [1_000_000])[0], clock)
    try:
        with _bar(Console(stderr=True), quiet=json) as progress:
            report = search(
                line, clock, bauds=baud or (), servo_ids=servo_ids, makes=makes, models=models, progress=progress
            )
    except KeyboardInterrupt:
        raise Interrupted("interrupted: nothing was changed") from None
    finally:
        line.close()
    if json:
        print_json(report)
    else:
        print_report(report, Console())
    raise typer.Exit(0 if report.servos and not report.absent else 1)


def _models(arm: str) -> "dict[int, ServoModel]":
    """The arm's servos by ID. Raises DriverError where it has several lines: one is scanned."""
    from drivers.errors import DriverError
    from drivers.servos.catalog import MODELS
    from servoloop.commands.options import known_arm

    file = known_arm(arm).file
    if len(file.lines()) > 1:
        raise DriverError(f"{arm} has several buses, and one port is scanned: name the IDs with --ids")
    return {joint.servo_id: MODELS[joint.model] for joint in file.joints.values()}


@contextmanager
def _bar(console: "Console", quiet: bool) -> Iterator["Progress"]:
    """A progress bar with the number of servos found so far."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[found]} found"))
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=quiet, transient=True) as bar:
        task = bar.add_task("", total=None, found=0)

        def progress(number: int, count: int, text: str, found: Sequence["ScannedServo"]) -> None:
            bar.update(task, completed=number, total=count, description=text, found=len(found))

        yield progress


def print_report(report: "ScanReport", console: "Console") -> None:
    """For people: a table of who is there, then what is wrong."""
    if report.servos:
        print_table(console, _table(report), "model", "mode", "alarms")
    else:
        console.print(f"{report.port}: nobody answers. Is the servos' supply on, and the cable in the right socket?")
    for servo in report.servos:
        for problem in servo.problems:
            console.print(f"! servo {servo.servo_id}: {problem.text}", style="yellow", highlight=False, markup=False)
    for servo_id in report.absent:
        text = "is absent: it answers at none of these rates. Check its power, its cable and its ID"
        console.print(f"! servo {servo_id}: {text}", style="yellow", highlight=False)
    for baud, count in report.noise.items():
        console.print(f"  {counted(count, 'byte')} of nobody at {baud} baud", highlight=False)
    if report.refused_bauds:
        refused = ", ".join(map(str, report.refused_bauds))
        console.print(f"  not tried, for the adapter cannot make them: {refused} baud", highlight=False)
    for what in report.skipped:
        console.print(f"  not looked for: {what} (name the make with --make, and it is)", highlight=False)


def _table(report: "ScanReport") -> "Table":
    from rich.table import Table

    columns = ("ID", "model", "firmware", "baud", "V", "°C", "torque", "mode", "alarms")
    table = Table(*columns, title=report.port)
    for one in report.servos:
        model = one.model or ("?" if one.model_number is None else f"? ({one.model_number})")
        torque = "?" if one.torque is None else "on" if one.torque else "off"
        volts = "?" if one.voltage_v is None else f"{one.voltage_v:.1f}"
        celsius = "?" if one.temperature_c is None else f"{one.temperature_c:.0f}"
        row = (model, one.firmware or "?", str(one.baud), volts, celsius, torque, one.operating_mode or "?")
        table.add_row(str(one.servo_id), *row, ", ".join(one.alarms), style="yellow" if one.problems else None)
    return table
