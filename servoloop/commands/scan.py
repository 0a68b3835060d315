"""``servoloop scan``: list the servos on a bus and their problems."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.commissioning_errors import LARGEST_BAUD, SMALLEST_BAUD
from drivers.printable import counted
from servoloop.commands.shared.console import JsonOption, print_json, text_console
from servoloop.commands.shared.line_options import device_of, interruptible
from servoloop.stack.tables import print_table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from commissioning.scan.examine import ScannedServo
    from commissioning.scan.scan import Progress, ScanReport
    from drivers.servos.catalog import Make
    from drivers.servos.register import ServoModel


class MakeChoice(Enum):
    """Make of servos, as an enumeration because typer does not support lists of literals."""

    feetech = "feetech"
    dynamixel = "dynamixel"

    @property
    def make(self) -> "Make":
        """Name of the make in the servo catalog."""
        return "feetech" if self is MakeChoice.feetech else "dynamixel"


def scan(
    port: Annotated[str | None, typer.Argument(help="Serial port (default: the only adapter).")] = None,
    baud: Annotated[
        list[int] | None,
        typer.Option(min=SMALLEST_BAUD, max=LARGEST_BAUD, help="Baud rate to try (default: all). May be repeated."),
    ] = None,
    ids: Annotated[str | None, typer.Option(help="IDs to ping (default: all), such as 1-6 or 1,2,5.")] = None,
    make: Annotated[
        list[MakeChoice] | None,
        typer.Option(help="Make to search for, even if servos of other makes respond. May be repeated."),
    ] = None,
    arm: Annotated[str | None, typer.Option(help="Arm whose servo IDs and models are checked.")] = None,
    json: JsonOption = False,
) -> None:
    """List the servos on a bus, of all makes and at all baud rates, and report their problems.

    The command only pings and reads; torque and registers do not change. After a servo has responded, the other wire
    protocol is tried only with --make. The exit status is 1 if no servo was found, an expected ID is missing, two
    servos have the same ID, or the model of a servo differs from --arm.
    Example: `servoloop scan /dev/ttyACM0`, `servoloop scan --ids 1-6 --baud 1000000`, `servoloop scan --arm so101`
    """

    from commissioning.scan.scan import ScanScope
    from commissioning.scan.scan import scan as search
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort
    from servoloop.bench.bus import parse_ids

    scope = ScanScope(baud or (), parse_ids(ids) if ids is not None else (), [one.make for one in make or ()])
    models = _models(arm) if arm else None
    clock, device = MonotonicClock(), device_of(port)
    line = SerialPort(device, (baud or [1_000_000])[0], clock)
    try:
        with interruptible(), _bar(text_console(stderr=True), quiet=json) as progress:
            report = search(line, clock, scope, models=models, progress=progress)
    finally:
        line.close()
    if json:
        print_json(report)
    else:
        print_report(report, text_console())
        if not report.servos:
            _print_rates(baud or ())
    raise typer.Exit(0 if report.complete else 1)


def _print_rates(bauds: Sequence[int]) -> None:
    """Report the requested baud rates that no supported servo has."""
    from commissioning.scan.steps import RATES

    known = sorted({rate for rates in RATES.values() for rate in rates})
    for baud in bauds:
        if baud not in known:
            typer.echo(f"! no supported servo has {baud} baud: use one of {', '.join(map(str, known))}")


def _models(arm: str) -> "dict[int, ServoModel]":
    """Return the servo models of an arm, keyed by servo ID. Raises DriverError if the arm has several buses."""
    from drivers.driver_errors import DriverError
    from drivers.servos.catalog import MODELS
    from servoloop.commands.shared.options import known_arm
    from servoloop.stack.arm_options import ServoArm

    file = known_arm(ServoArm(arm)).file
    if len(file.lines()) > 1:
        raise DriverError(f"{arm} has several buses, but a scan covers one port; use --ids instead of --arm")
    return {joint.servo_id: MODELS[joint.model] for joint in file.joints.values()}


@contextmanager
def _bar(console: "Console", quiet: bool) -> Iterator["Progress"]:
    """Show a progress bar with the number of servos found so far."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[found]} found"))
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=quiet, transient=True) as bar:
        task = bar.add_task("", total=None, found=0)

        def progress(number: int, count: int, text: str, found: Sequence["ScannedServo"]) -> None:
            bar.update(task, completed=number, total=count, description=text, found=len(found))

        yield progress


def print_report(report: "ScanReport", console: "Console") -> None:
    """Print a table of the servos, followed by their problems."""
    if report.servos:
        print_table(console, _table(report), "model", "mode", "alarms")
    else:
        console.print(f"{report.port}: no servo responds. Check the power supply of the servos and their cable.")
    for servo in report.servos:
        for problem in servo.problems:
            console.print(f"! servo {servo.servo_id}: {problem.text}", style="yellow", highlight=False)
    for servo_id in report.absent:
        text = "does not respond at any of these baud rates; check its power, its cable and its ID"
        console.print(f"! servo {servo_id}: {text}", style="yellow", highlight=False)
    for baud, count in report.noise.items():
        console.print(f"  {counted(count, 'byte')} of noise at {baud} baud", highlight=False)
    if report.refused_bauds:
        refused = ", ".join(map(str, report.refused_bauds))
        console.print(f"  not tried, because the adapter does not support them: {refused} baud", highlight=False)
    for what in report.skipped:
        console.print(f"  not searched for: {what} (choose the make with --make)", highlight=False)


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
