"""``servoloop calibrate``: the servos' counts become the URDF's angles."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from commissioning.calibrations import Row, calibration_rows, export_calibration, import_calibration
from commissioning.lerobot import ITS_ZERO
from commissioning.lerobot_import import Imported
from drivers.errors import DriverError
from hal.errors import DescriptionError
from servoloop.commands.console import JsonOption, YesOption, print_json, print_table
from servoloop.commands.line_options import PortOption, named_devices
from servoloop.commands.options import ArmOption, RobotOption, UrdfOption, known_arm
from servoloop.stack.arm_folders import OWN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from commissioning.calibrate.run import Outcome
    from servoloop.stack.arm_folders import Arm
    from servoloop.stack.robot_files import ServoFiles


AUTO = "The arm moves by itself now, slowly, from stop to stop: clear its table, keep away. Any key stops it. Begin?"


def calibrate(
    arm: Annotated[str, typer.Option(help="The arm: a name that `servoloop arms` lists, or its folder.")],
    port: PortOption = None,
    auto: Annotated[
        bool, typer.Option("--auto", help="Nobody moves the arm: it is driven softly to its stops.")
    ] = False,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Find each joint's zero and direction, and store them beside the arm's robot file.

    Torque is off unless a sentence says that it goes on, and off at the end, whatever happens. Nothing is written
    before you have seen what was found. With --auto somebody still looks on, and says which way each joint moved.
    Example: `servoloop calibrate --arm so101 --port /dev/ttyACM0`
    """
    from commissioning.ports.adapters import only_port
    from servoloop.commands.calibrate_terminal import Terminal
    from servoloop.stack.arm_folders import find_arm, read_arm_servos
    from servoloop.stack.signals import Signals

    found = find_arm(arm)
    files = read_arm_servos(found)
    buses = list(files.robot.file.lines())
    if len(buses) != 1:
        raise DescriptionError(
            f"{found.robot}: an arm with several buses is calibrated bus by bus: not yet by this verb"
        )
    _require_writable(found.robot)
    (device,) = named_devices([port or only_port()], buses, arm).values()
    with Signals("servos that were under torque hold") as signals, Terminal(signals, yes) as terminal:
        outcome = _calibrated(found, files, device, terminal, auto)
    if json:
        print_json(_outcome_as_json(outcome))
    elif outcome.stored:
        former = outcome.path.with_name(outcome.path.name + ".1")
        typer.echo(f"stored in {outcome.path}{f'; the former one is {former}' if former.exists() else ''}")
    raise typer.Exit(0 if outcome.stored else 1)


def _require_writable(robot: Path) -> None:
    """Raise DriverError where no calibration could be stored: who has moved every joint is told too late."""
    from servoloop.stack.robot_files import require_writable

    try:
        require_writable(robot.parent)
    except DriverError as error:
        raise DriverError(f"{error}: copy the arm's folder (docs/calibrate.md) and name that with --arm") from error


def _calibrated(arm: "Arm", files: "ServoFiles", port: str, terminal: Any, auto: bool) -> "Outcome":
    from commissioning.calibrate.by_itself import by_itself
    from commissioning.calibrate.run import calibrate as run
    from drivers.bus.bus import Bus
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort
    from servoloop.stack.hardware import servo_bus
    from servoloop.stack.processes import Interrupted

    clock, plan = MonotonicClock(), arm.file.calibration
    joints = [joint.between_stops() for joint in files.robot.joints]
    baud = next(iter(files.robot.file.lines().values())).baud

    def open_bus() -> Bus:
        return servo_bus(files.robot.file, SerialPort(port, baud, clock), clock)

    if auto and not terminal.confirm(AUTO):
        raise Interrupted("nothing was moved")
    measure = by_itself(open_bus, plan, terminal, clock, terminal.stopped) if auto else None
    return run(arm.robot, joints, plan.joints, open_bus, terminal, clock, measure, terminal.stopped)


def _outcome_as_json(outcome: "Outcome") -> dict[str, Any]:
    """The outcome for programs."""
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
    link: Annotated[Path, typer.Argument(help="Where `servoloop emulate` serves the bus.")],
    do: Annotated[str, typer.Argument(help="hold, release, move, look, lay (the table); connect, disconnect (a box).")],
    joint: Annotated[str | None, typer.Argument(help="One joint; hold, release and connect take all without.")] = None,
    position: Annotated[float | None, typer.Argument(help="Where to move it, rad or m as the URDF counts.")] = None,
    json: JsonOption = False,
) -> None:
    """Take the virtual arm by the hand, to practise: hold joints, move one to a position, let go.

    Example: `servoloop hand ./bus hold`, `servoloop hand ./bus move elbow_flex 1.2`
    """
    from sim_backend.control import ask, control_path

    command: dict[str, Any] = {"do": do, "joints": [joint] if joint else []}
    if do == "move" and (joint is None or position is None):
        raise DriverError("move takes a joint and a position: servoloop hand ./bus move elbow_flex 1.2")
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
        typer.echo(f"{name:18} {state['position']:+8.4f}  {held}{'' if state['arrived'] else ', on its way'}")


def _connected(found: "Mapping[str, Mapping[str, Any]]") -> str:
    """The joints whose servos are connected, with the IDs that the servos have."""
    names = [f"{name} (ID {state['servo_id']})" for name, state in found.items() if state["connected"]]
    if not names:
        return "no servo is connected"
    every = " (the whole chain)" if len(names) == len(found) else ""
    return f"connected{every}: {', '.join(names)}"


app = typer.Typer(no_args_is_help=True, help="An arm's calibration: shown, and exchanged with LeRobot.")
LerobotArgument = Annotated[Path, typer.Argument(help="LeRobot's calibration file, JSON.")]


@app.command("import")
def import_(
    file: LerobotArgument,
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    urdf: UrdfOption = None,
    prefix: Annotated[str, typer.Option(help="Prefix of this arm's joints in the file, such as LeKiwi's arm_.")] = "",
    json: JsonOption = False,
) -> None:
    """Take LeRobot's calibration for this arm: directions, homing offsets and travel; zeros found anew in the travel.

    Nothing is written to servos: they hold LeRobot's offsets already. The former calibration file is kept.
    Example: `servoloop calibration import my_arm.json --arm so101`
    """
    known = known_arm(arm, urdf, robot)
    made, written = import_calibration(file, known.robot, known.joints, known.plans, prefix)
    if json:
        print_json({"written": str(written), "joints": [_imported_as_json(one) for one in made]})
        return
    print_table(Console(), _imported(made), "joint", "doubtful")
    typer.echo(f"{ITS_ZERO}.\nWritten: {written}")


@app.command()
def export(
    file: LerobotArgument,
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    urdf: UrdfOption = None,
    json: JsonOption = False,
) -> None:
    """Write this arm's calibration as LeRobot's file. A former file is kept with .1 behind its name.

    Example: `servoloop calibration export my_arm.json --arm so101`
    """
    export_calibration(file, known_arm(arm, urdf, robot).robot)
    if json:
        print_json({"written": str(file)})
    else:
        typer.echo(f"{file} has the servos' travel and offsets, and no zeros: {ITS_ZERO}")


@app.command()
def show(arm: ArmOption = OWN, robot: RobotOption = None, urdf: UrdfOption = None, json: JsonOption = False) -> None:
    """Show each joint's direction, zero, homing offset, and its travel against the URDF's.

    Example: `servoloop calibration show --arm so101`
    """
    known = known_arm(arm, urdf, robot)
    rows = calibration_rows(known.robot, known.joints)
    if json:
        print_json(rows)
    else:
        print_table(Console(), _shown(rows), "joint", "doubtful")


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
    table = Table("joint", "sign", "zero", "found", "at LeRobot's zero", "offset", "doubtful")
    for one in made:
        at = f"{one.at_lerobot_zero:+.3f}"
        counts = str(one.made.zero_counts)
        table.add_row(
            one.joint.name, f"{one.made.sign:+d}", counts, one.source, at, str(one.made.homing_offset), one.doubt
        )
    return table


def _shown(rows: list[Row]) -> Table:
    table = Table("joint", "servo", "sign", "zero", "offset", "travel", "URDF's", "doubtful")
    for row in rows:
        travel = "" if row.travel is None else f"{row.travel:.3f}"
        offset = "" if row.homing_offset is None else str(row.homing_offset)
        numbers = str(row.servo_id), f"{row.sign:+d}", str(row.zero_counts), offset, travel, f"{row.urdf_range:.3f}"
        table.add_row(row.joint, *numbers, row.doubt)
    return table
