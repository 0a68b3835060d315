"""``servoloop doctor``: list the faults of an arm, most likely cause first, with the commands that fix them."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.commands.shared.console import JsonOption, YesOption, confirm, print_json, text_console
from servoloop.commands.shared.line_options import PortsOption, interruptible, served_devices
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.stack.arm_options import ServoArm
from servoloop.stack.tables import print_table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from commissioning.doctor.motion import Move
    from commissioning.doctor.report import BusFigures, DoctorReport
    from drivers.clock import Clock
    from servoloop.stack.robot_files import ServoFiles
    from servoloop.stack.signals import Signals

STYLES = {"fault": "red", "warning": "yellow", "note": "dim"}
MOVES = (
    "Each joint will move slowly by up to 0.4 rad with torque enabled. Afterwards the torque is off again. Lift the "
    "arm off its table, make sure that it has room, and hold it if it could fall. Continue?"
)


@grouped_options
def doctor(
    *,
    port: PortsOption = None,
    arm: ServoArm,
    report_file: Annotated[
        Path | None, typer.Option("--report", help="Markdown file for the full report, to attach to a bug report.")
    ] = None,
    move: Annotated[
        bool,
        typer.Option(
            "--move", help="Ask for confirmation, then test gears, gains and gravity hold with small, slow motions."
        ),
    ] = False,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Diagnose an arm: check its port, bus, servos, settings, supply and calibration.

    Without --move, the command only reads from the servos. Nothing moves, and the torque does not change. Uncertain
    findings are reported as warnings. The exit status is 1 if there are faults, and 130 if --move was interrupted.
    Example: `servoloop doctor --port /dev/ttyACM0`, `servoloop doctor --arm so101 --report doctor.md`
    """

    from commissioning.atomic_write import require_file, write_file
    from commissioning.doctor.doctor import ExaminedArm
    from commissioning.doctor.doctor import doctor as examine
    from commissioning.doctor.report import markdown
    from commissioning.ports.machine import Machine
    from commissioning.slow_arm import ENDED_EARLY
    from drivers.clock import MonotonicClock
    from hal.robot_file.calibration_file import load_calibration
    from servoloop.stack.devices import VIRTUAL
    from servoloop.stack.processes import Interrupted
    from servoloop.stack.signals import Signals

    if report_file is not None:
        require_file(report_file, ".md")
    files = arm.read()
    clock = MonotonicClock()
    examined = ExaminedArm(files.robot, arm.arm, load_calibration(files.robot_path))
    with served_devices(port, files) as devices:
        if move:
            confirm(MOVES, yes)
        # Without motions, a signal ends the command immediately.
        with Signals(ENDED_EARLY) if move else interruptible() as signals:
            motion = _motion(files, clock, signals)
            report = examine(examined, devices, clock, move=motion)
    virtual = VIRTUAL in (port or ())
    if virtual:
        report = _on_emulator(report, Path(next(iter(devices.values()))).parent)
    if json:
        print_json(report)
    else:
        print_report(report, text_console())
        if virtual and any(one.command for one in report.findings):
            typer.echo(f"The virtual servos have ended. Before you run a command, start: {_emulate(arm.arm)}")
    if report_file is not None:
        write_file(report_file, markdown(report, Machine().user.name, files.robot_path))
    if signals and signals.count:
        raise Interrupted("the motion test was interrupted")
    raise typer.Exit(0 if report.healthy else 1)


def _motion(files: "ServoFiles", clock: "Clock", signals: "Signals | None") -> "Move":
    """Return the motion test, which can be stopped by signals. If ``signals`` is None, return a test that does not move
    any joint."""
    from commissioning.doctor.motion import SmallMotions, no_move
    from drivers.port.serial_port import SerialPort
    from hal.compensation.gravity import Gravity

    if signals is None:
        return no_move
    gravity = Gravity(files.description, [joint.name for joint in files.robot.joints])
    return SmallMotions(lambda device, baud: SerialPort(device, baud, clock), clock, gravity, lambda: signals.count)


def _emulate(arm: str) -> str:
    """Return the command that serves virtual servos at ./bus."""
    return f"servoloop emulate ./bus --arm {arm}"


def _on_emulator(report: "DoctorReport", folder: Path) -> "DoctorReport":
    """Return the report of virtual servos, with ./bus as the port in its commands, because the servos have ended."""
    shown = [one.command and one.command.replace(f"{folder}/", "./") for one in report.findings]
    findings = tuple(replace(one, command=command) for one, command in zip(report.findings, shown, strict=True))
    return replace(report, findings=findings)


def print_report(report: "DoctorReport", console: "Console") -> None:
    """Print the findings and a table of the servos on each bus."""
    for number, one in enumerate(report.findings, 1):
        where = f"{one.place}: " if str(one.place) else ""
        console.print(f"{number}. {one.severity}: {where}{one.symptom}", style=STYLES[one.severity],
                      highlight=False)  # fmt: skip
        console.print(f"   {one.cause}", highlight=False)
        if one.command:
            console.print(f"   run: {one.command}", style="bold", highlight=False, soft_wrap=True)
    for bus in report.buses:
        if bus.servos:
            print_table(console, _table(bus), "joint", "model", "answers", "alarms")
    if report.healthy:
        console.print("no faults found", style="green")


def _table(bus: "BusFigures") -> "Table":
    from rich.table import Table

    table = Table("joint", "ID", "model", "answers", "position", "V", "°C", "torque", "alarms", title=bus.port)
    for one in bus.servos:
        row = (
            one.heard,
            "" if one.position is None else f"{one.position:.3f}",
            "" if one.voltage_v is None else f"{one.voltage_v[0]:.1f}",
            "" if one.temperature_c is None else f"{one.temperature_c:.0f}",
            {None: "", True: "on", False: "off"}[one.torque],
        )
        table.add_row(one.joint, str(one.servo_id), one.model, *row, ", ".join(one.alarms))
    return table
