"""``servoloop calibrate``, ``calibration`` and ``hand``: calibrate an arm, and practice on a virtual arm."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from commissioning.calibrations import CalibrationRow, calibration_rows, export_calibration, import_calibration
from commissioning.lerobot import ITS_ZERO
from commissioning.lerobot_import import Imported
from drivers.driver_errors import DriverError
from servoloop.commands.shared.console import JsonOption, YesOption, print_json, text_console
from servoloop.commands.shared.line_options import named_devices
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import known_arm
from servoloop.stack.arm_options import ServoArm
from servoloop.stack.shipped_files import ARM_FILE
from servoloop.stack.tables import print_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from commissioning.calibrate.run import CalibrationOutcome
    from servoloop.stack.arm_folders import ArmFolder
    from servoloop.stack.robot_files import ServoFiles


AUTO = (
    "The arm will now move slowly from stop to stop on its own. Clear the space around it and keep away. Any key stops "
    "it. Continue?"
)
LIMITS_OFF = (
    ". The position limits in the servos may be disabled: switch the supply of the servos off and on to restore them"
)


def calibrate(
    arm: Annotated[str, typer.Option(help="Arm: a name that `servoloop arms` lists, or an arm folder.")],
    port: Annotated[
        str | None,
        typer.Option(help="Serial port (default: the only adapter); NAME=PATH for one of several buses."),
    ] = None,
    auto: Annotated[
        bool, typer.Option("--auto", help="Drive the joints gently to their stops instead of asking you to move them.")
    ] = False,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Find the zero and direction of each joint, and store them next to the robot file.

    Torque is off unless a message announces that it will be enabled, and it is always off at the end. Nothing is stored
    until you have seen and confirmed the result. With --auto, you must still watch the arm and confirm the direction in
    which each joint moved. If an arm has several buses, they are calibrated one at a time.
    Example: `servoloop calibrate --arm so101 --port /dev/ttyACM0`
    """
    from commissioning.slow_arm import ENDED_EARLY
    from servoloop.commands.output.calibrate_terminal import Terminal
    from servoloop.stack.arm_folders import find_arm, read_arm_servos
    from servoloop.stack.signals import Signals

    found = find_arm(arm)
    files = read_arm_servos(found)
    if auto:
        found.file.calibration.check_auto([joint.name for joint in files.robot.joints], found.folder / ARM_FILE)
    bus, device = _bus_and_device(port, files, arm)
    _require_writable(found.robot)
    with Signals(ENDED_EARLY + (LIMITS_OFF if auto else "")) as signals, Terminal(signals, yes) as terminal:
        outcome = _calibrated(found, files, (bus, device), terminal, auto)
    if json:
        print_json(_outcome_as_json(outcome))
    elif outcome.stored:
        former = outcome.path.with_name(outcome.path.name + ".1")
        backup = f"; the previous calibration is in {former}" if former.exists() else ""
        typer.echo(f"Calibration stored in {outcome.path}{backup}")
    raise typer.Exit(0 if outcome.stored else 1)


def _bus_and_device(port: str | None, files: "ServoFiles", arm: str) -> tuple[str, str]:
    """Return the name and the device of the bus to calibrate. Raises DriverError."""
    from commissioning.ports.adapters import only_port

    buses = list(files.robot.file.lines())
    if len(buses) > 1:
        bus, _, device = (port or "").partition("=")
        if bus not in buses or not device:
            raise DriverError(
                f"{arm} has the buses {', '.join(buses)}, which are calibrated one at a time: "
                f"pass --port {buses[0]}=PATH for the first bus"
            )
        return bus, named_devices([f"{bus}={device}"], [bus], arm)[bus]
    ((bus, device),) = named_devices([port or only_port()], buses, arm).items()
    return bus, device


def _require_writable(robot: Path) -> None:
    """Raise DriverError before the user moves any joint if the calibration cannot be stored."""
    from commissioning.atomic_write import require_writable

    try:
        require_writable(robot.parent)
    except DriverError as error:
        raise DriverError(f"{error}; copy the arm's folder (docs/calibrate.md) and pass the copy with --arm") from error


def _calibrated(
    arm: "ArmFolder", files: "ServoFiles", line: tuple[str, str], terminal: Any, auto: bool
) -> "CalibrationOutcome":
    """Calibrate the joints on one bus. ``line`` contains the name and the device of the bus."""
    from commissioning.calibrate.by_itself import by_itself
    from commissioning.calibrate.run import JointsToCalibrate
    from commissioning.calibrate.run import calibrate as run
    from drivers.bus.bus import Bus
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort, require_port
    from servoloop.stack.hardware import servo_bus
    from servoloop.stack.processes import Interrupted

    (bus, device), clock = line, MonotonicClock()
    joints = [joint.between_stops() for joint in files.robot.joints if joint.bus == bus]
    others = [joint.name for joint in files.robot.joints if joint.bus != bus]
    plan = arm.file.calibration.part_of([joint.name for joint in joints])
    baud = files.robot.file.lines()[bus].baud

    def open_bus() -> Bus:
        return servo_bus(files.robot.file, SerialPort(device, baud, clock), clock, bus)

    if others:
        terminal.say(f"Only the joints on the bus {bus} are calibrated. The other joints keep their calibration")
    require_port(device, baud)
    if auto and not terminal.confirm(AUTO):
        raise Interrupted("canceled; the arm was not moved")
    task = JointsToCalibrate(arm.robot, joints, plan.joints, others)
    measure = by_itself(open_bus, plan, terminal, clock, terminal.stopped) if auto else None
    return run(task, open_bus, terminal, clock, measure, terminal.stopped)


def _outcome_as_json(outcome: "CalibrationOutcome") -> dict[str, Any]:
    """Return the outcome as data for JSON output."""
    return {
        "stored": outcome.stored,
        "file": str(outcome.path),
        "tried_under_torque": outcome.tried,
        "joints": {
            one.joint: {
                "servo_id": one.servo_id,
                "sign": one.made.sign,
                "zero_counts": one.made.zero_counts,
                "homing_offset": one.made.homing_offset,
                "lower_counts": one.made.lower_counts,
                "upper_counts": one.made.upper_counts,
                "zero_moved": one.zero_moved,
                "zero_uncertainty": one.uncertainty,
                "doubt": one.doubt or None,
            }
            for one in outcome.differences
        },
    }


def hand(
    link: Annotated[Path, typer.Argument(help="Path at which `servoloop emulate` serves the bus.")],
    do: Annotated[
        str,
        typer.Argument(
            help="hold, release or move: act on joints; look: print the positions; lay: put the cube, the bins and "
            "the stand back; connect or disconnect: plug or unplug servos (with `emulate --box`)."
        ),
    ],
    joint: Annotated[
        str | None, typer.Argument(help="Joint name. If omitted, hold, release and connect apply to all joints.")
    ] = None,
    position: Annotated[float | None, typer.Argument(help="Target position for move, in rad or m.")] = None,
    json: JsonOption = False,
) -> None:
    """Move the joints of a virtual arm as if by hand, to practice calibration.

    Example: `servoloop hand ./bus hold`, `servoloop hand ./bus move elbow_flex 1.2`
    """
    from sim_backend.control import ask, control_path

    command: dict[str, Any] = {"do": do, "joints": [joint] if joint else []}
    if do == "move" and (joint is None or position is None):
        raise DriverError("move needs a joint and a position, such as: servoloop hand ./bus move elbow_flex 1.2")
    if position is not None and do != "move":
        raise DriverError(f"{do} takes no position: omit {position:g}, or use move")
    if do == "lay" and joint is not None:
        raise DriverError(f"lay takes no joint: omit {joint}")
    if position is not None:
        command["position"] = position
    try:
        found = ask(control_path(link), command)
    except ValueError as error:
        raise DriverError(str(error)) from error
    if json:
        print_json(found)
        return
    if do in ("connect", "disconnect"):
        typer.echo(_connected(found))
        return
    for name, state in found.items():
        held = "held" if state["held"] else "free"
        typer.echo(f"{name:18} {state['position']:+8.4f}  {held}{'' if state['arrived'] else ', moving'}")


def _connected(found: "Mapping[str, Mapping[str, Any]]") -> str:
    """Return a line that lists the joints whose servos are connected, with the servo IDs."""
    names = [f"{name} (ID {state['servo_id']})" for name, state in found.items() if state["connected"]]
    if not names:
        return "No servo is connected."
    every = " (all servos)" if len(names) == len(found) else ""
    return f"connected{every}: {', '.join(names)}"


app = typer.Typer(
    no_args_is_help=True, help="Show an arm's calibration, import it from LeRobot, or export it to LeRobot."
)
LerobotArgument = Annotated[Path, typer.Argument(help="LeRobot calibration file (JSON).")]


@app.command("import")
@grouped_options
def import_(
    file: LerobotArgument,
    arm: ServoArm,
    prefix: Annotated[str, typer.Option(help="Prefix of the joint names in the file, such as arm_ for LeKiwi.")] = "",
    json: JsonOption = False,
) -> None:
    """Import a LeRobot calibration file for an arm.

    Directions, homing offsets and travel are read from the file; the zeros are computed from the travel. Nothing is
    written to the servos, because they already contain LeRobot's offsets. The previous calibration file is kept as a
    backup. Example: `servoloop calibration import my_arm.json --arm so101`
    """
    known = known_arm(arm)
    made, written = import_calibration(file, known.robot, known.joints, known.plans, prefix)
    if json:
        print_json({"written": str(written), "joints": [_imported_as_json(one) for one in made]})
        return
    print_table(text_console(), _imported(made), "joint", "warning")
    typer.echo(f"{ITS_ZERO}.\nWritten: {written}")


@app.command()
@grouped_options
def export(
    file: LerobotArgument,
    arm: ServoArm,
    json: JsonOption = False,
) -> None:
    """Export an arm's calibration to a LeRobot file.

    An existing file is kept as a backup with the suffix .1.
    Example: `servoloop calibration export my_arm.json --arm so101`
    """
    export_calibration(file, known_arm(arm).robot)
    if json:
        print_json({"written": str(file)})
    else:
        typer.echo(f"{file} contains the travel and homing offsets of the servos, but not their zeros: {ITS_ZERO}")


@app.command()
@grouped_options
def show(arm: ServoArm, json: JsonOption = False) -> None:
    """Show the direction, zero, homing offset and travel of each joint, and its range in the URDF.

    Example: `servoloop calibration show --arm so101`
    """
    known = known_arm(arm)
    rows = calibration_rows(known.robot, known.joints)
    if json:
        print_json(rows)
    else:
        print_table(text_console(), _shown(rows), "joint", "warning")


def _imported_as_json(one: Imported) -> dict[str, Any]:
    return {
        "joint": one.joint.name,
        "servo_id": one.joint.servo_id,
        **asdict(one.made),
        "zero": one.source,
        "at_lerobot_zero": one.at_lerobot_zero,
        "doubt": one.doubt,
    }


def _imported(made: list[Imported]) -> Table:
    table = Table("joint", "sign", "zero", "source", "at LeRobot's zero", "offset", "warning")
    for one in made:
        at = f"{one.at_lerobot_zero:+.3f}"
        counts = str(one.made.zero_counts)
        table.add_row(
            one.joint.name, f"{one.made.sign:+d}", counts, one.source, at, str(one.made.homing_offset), one.doubt
        )
    return table


def _shown(rows: list[CalibrationRow]) -> Table:
    table = Table("joint", "servo", "sign", "zero", "offset", "travel", "URDF range", "warning")
    for row in rows:
        travel = "" if row.travel is None else f"{row.travel:.3f}"
        offset = "" if row.homing_offset is None else str(row.homing_offset)
        numbers = str(row.servo_id), f"{row.sign:+d}", str(row.zero_counts), offset, travel, f"{row.urdf_range:.3f}"
        table.add_row(row.joint, *numbers, row.doubt)
    return table
