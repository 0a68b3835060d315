"""``servoloop arms``: list, create, check and draw arm folders."""

import json
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from commissioning.atomic_write import make_folder, require_file
from servoloop.commands.shared.console import text_console
from servoloop.extras import missing_extras, require_extras
from servoloop.stack.arm_folders import PATHS, ArmFolder, arms, find_arm, read_arm
from servoloop.stack.terminal import print_styled

app = typer.Typer()

FOLDER: Final = Path("out") / "arms"

JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]


@app.callback(invoke_without_command=True)
def list_arms(context: typer.Context, as_json: JsonOption = False) -> None:
    """List the arms that come with servoloop. Pass their names with `--arm`.

    Example: `servoloop arms`
    """
    if context.invoked_subcommand:
        return
    found = arms()
    if as_json:
        typer.echo(json.dumps([_content(arm) for arm in found], indent=2))
    else:
        print_table(found, text_console())


def print_table(found: list[ArmFolder], console: Console) -> None:
    """Print the arms as a table."""
    table = Table("arm", "description", "license")
    for arm in found:
        table.add_row(arm.name, arm.file.description, arm.file.license)
    console.print(table)


@app.command()
def new(
    name: Annotated[Path, typer.Argument(help="Name or path of the new arm folder.")],
    urdf: Annotated[Path, typer.Argument(help="URDF file of the arm.")],
    servo: Annotated[str, typer.Option(help="Servo model.")] = "sts3215",
) -> None:
    """Create an arm folder from a URDF, with a robot file, controllers and a simulated scene.

    Example: `servoloop arms new my_arm robot.urdf`, then `servoloop emulate ./bus --arm ./my_arm`
    """
    from servoloop.arms.new import new_arm
    from servoloop.stack.robot_check import check_arm

    for path in new_arm(name, urdf, servo):
        typer.echo(path)
    for problem in check_arm(name):
        print_styled(f"! {problem}", fg="yellow")
    place = name if name.is_absolute() else f"./{name}"
    if sentence := missing_extras("the scene for virtual servos", "sim"):
        typer.echo(f"No scene.xml was written: {sentence}")
        typer.echo(f"Next, run: servoloop up --arm {place} --port /dev/ttyACM0")
        return
    typer.echo(f"Next, run: servoloop emulate ./bus --arm {place}")
    typer.echo(f"Then, in another terminal: servoloop up --arm {place} --port ./bus")


@app.command()
def combine(
    arms: Annotated[
        list[str],
        typer.Argument(metavar="PREFIX=ARM", help="Prefix of an arm, and its name (see `servoloop arms`) or folder."),
    ],
    out: Annotated[Path, typer.Option(help="New arm folder.")],
    base: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PREFIX=X,Y,Z,YAW",
            help="Position of an arm's base on the table, in m, and its yaw angle, in rad (default: side by side).",
        ),
    ] = None,
) -> None:
    """Combine several arms on one table into a single robot, and create an arm folder for this robot.

    The names of all joints, links and controllers of an arm start with the arm's prefix. Each arm has its own port.
    Example: `servoloop arms combine left=so101 right=so101 --out two_arms`
    """
    from servoloop.arms.combine import combine as write
    from servoloop.arms.combine import parse_arms, parse_bases

    named = parse_arms(arms)
    for path in write(out, named, parse_bases(base or [], list(named))):
        typer.echo(path)
    place = out if out.is_absolute() else f"./{out}"
    ports = " ".join(f"--port {name}=/dev/ttyACM{number}" for number, name in enumerate(named))
    if sentence := missing_extras("the scene for virtual servos", "sim"):
        typer.echo(f"No scene.xml was written: {sentence}")
    elif not (out / "scene.xml").exists():
        typer.echo("No scene.xml was written because one of the arms has no scene")
    else:
        typer.echo(f"Next, run: servoloop up --arm {place}")
    typer.echo(f"With real arms: servoloop up --arm {place} {ports}")


@app.command()
def check(
    folder: Annotated[str, typer.Argument(help="Arm folder, or a name that `servoloop arms` lists.")],
    as_json: JsonOption = False,
) -> None:
    """Check an arm's files and list all problems. The exit status is 1 if there are problems.

    Example: `servoloop arms check ./my_arm`
    """
    from servoloop.manual.poses import pose_problems
    from servoloop.stack.robot_check import check_arm, missing_parts, scene_unchecked

    if sentence := scene_unchecked():
        typer.echo(sentence, err=True)
    place = Path(folder) if Path(folder).is_dir() else find_arm(folder).folder
    problems = [*check_arm(place), *pose_problems(place)]
    if as_json:
        typer.echo(json.dumps({"folder": str(place), "problems": problems}, indent=2))
    else:
        summary = [] if problems else [f"{place.name}: no problems found", *missing_parts(read_arm(place))]
        typer.echo("\n".join([*problems, *summary]))
    raise typer.Exit(1 if problems else 0)


@app.command()
def show(
    arm: Annotated[str, typer.Argument(help="Name that `servoloop arms` lists, or an arm folder.")],
    out: Annotated[Path | None, typer.Option(help="PNG file to write (default: out/arms/NAME.png).")] = None,
) -> None:
    """Draw an arm with the name, servo and positive direction of each joint.

    All joints are at zero. Each arrow points in the direction of increasing positions. The text next to an arrow
    describes the direction in the same words as `servoloop calibrate` does. Example: `servoloop arms show so101`
    """
    require_extras("the picture of an arm", "sim", "view")
    from servoloop.arm_pictures.show import draw_arm, write_picture

    found = find_arm(arm)
    path = out or FOLDER / f"{found.name}.png"
    make_folder(path.parent)
    require_file(path, ".png")
    write_picture(draw_arm(found), path)
    typer.echo(path)


@app.command()
def moveit(
    arm: Annotated[str, typer.Argument(help="Name that `servoloop arms` lists, or an arm folder.")],
    folder: Annotated[
        Path, typer.Argument(help="Folder for the files. Existing files are kept as backups with the suffix .1.")
    ],
) -> None:
    """Write a MoveIt configuration for an arm.

    The configuration consists of the SRDF and files for limits, kinematics, controllers, planners and the planning
    scene.
    Example: `servoloop arms moveit so101 so101_moveit`
    """
    from servoloop.moveit.files import write_moveit

    for path in write_moveit(find_arm(arm), folder):
        typer.echo(path)


def _content(arm: ArmFolder) -> dict[str, str]:
    """Return the arm's data for JSON output, with absolute paths."""
    files = {name: str(getattr(arm, name)) for name in PATHS}
    about = {"description": arm.file.description, "source": arm.file.source, "license": arm.file.license}
    return {"name": arm.name, **about, "folder": str(arm.folder), **files}
