"""``servoloop calibration``: LeRobot's calibration file in and out, and what this arm's calibration is."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from commissioning.calibrations import Row, calibration_rows, export_calibration, import_calibration
from commissioning.lerobot import ITS_ZERO
from commissioning.lerobot_import import Imported
from servoloop.arms.folder import OWN
from servoloop.verbs.arm_options import ArmOption, RobotOption, UrdfOption, known_arm
from servoloop.verbs.output import JsonOption, print_json, print_table

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
