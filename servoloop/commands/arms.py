"""``servoloop arms``: what is ready, and what is wrong with a folder."""

import json
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from servoloop.dashboard.browser import require_view
from servoloop.stack.arm_folders import PATHS, Arm, arms, find_arm, read_arm
from servoloop.stack.robot_files import make_folder
from servoloop.stack.terminal import print_styled

app = typer.Typer()

FOLDER: Final = Path("out") / "arms"

JsonOption = Annotated[bool, typer.Option("--json", help="JSON instead of words.")]


@app.callback(invoke_without_command=True)
def list_arms(context: typer.Context, as_json: JsonOption = False) -> None:
    """List the arms that are ready: what `--arm` takes.

    Example: `servoloop arms`
    """
    if context.invoked_subcommand:
        return
    found = arms()
    if as_json:
        typer.echo(json.dumps([_content(arm) for arm in found], indent=2))
    else:
        print_table(found, Console())


def print_table(found: list[Arm], console: Console) -> None:
    """Print the arms for people."""
    table = Table("arm", "what it is", "licence")
    for arm in found:
        table.add_row(arm.name, escape(arm.file.description), arm.file.license)
    console.print(table)


@app.command()
def new(
    name: Annotated[Path, typer.Argument(help="Name of the arm: a new folder here; or a path to it.")],
    urdf: Annotated[Path, typer.Argument(help="Robot description, as any URDF.")],
    servo: Annotated[str, typer.Option(help="Model of the servos.")] = "sts3215",
) -> None:
    """Write the folder of an arm of your own: description, robot file, controllers and simulated scene.

    Example: `servoloop arms new my_arm robot.urdf`, then `servoloop emulate ./bus --arm ./my_arm`
    """
    from servoloop.arms.new import new_arm
    from servoloop.stack.robot_check import check_arm

    for path in new_arm(name, urdf, servo):
        typer.echo(path)
    for problem in check_arm(name):
        print_styled(f"! {problem}", fg="yellow")
    place = name if name.is_absolute() else f"./{name}"
    typer.echo(f"next: servoloop emulate ./bus --arm {place}")
    typer.echo(f"and in another terminal: servoloop up --arm {place} --port ./bus")


@app.command()
def check(
    folder: Annotated[str, typer.Argument(help="An arm's folder, or the name of one that is ready.")],
    as_json: JsonOption = False,
) -> None:
    """Say all that is wrong with an arm, at once; exit with 0 if it is nothing.

    Example: `servoloop arms check ./my_arm`
    """
    from servoloop.stack.robot_check import check_arm, missing_parts

    place = Path(folder) if Path(folder).is_dir() else find_arm(folder).folder
    problems = check_arm(place)
    if as_json:
        typer.echo(json.dumps({"folder": str(place), "problems": problems}, indent=2))
    else:
        right = [] if problems else [f"{place.name} is right", *missing_parts(read_arm(place))]
        typer.echo("\n".join([*problems, *right]))
    raise typer.Exit(1 if problems else 0)


@app.command()
def show(
    arm: Annotated[str, typer.Argument(help="An arm that `servoloop arms` lists, or its folder.")],
    out: Annotated[Path | None, typer.Option(help="The picture, PNG; without it out/arms/NAME.png.")] = None,
) -> None:
    """Draw an arm with its joints' names, servos and directions.

    The joints are at zero. An arrow points to greater positions; the sentence is what calibrate asks for.
    Example: `servoloop arms show so101`
    """
    require_view("the picture of an arm", "trimesh")
    from servoloop.arm_pictures.show import draw_arm, write_picture

    found = find_arm(arm)
    path = out or FOLDER / f"{found.name}.png"
    make_folder(path.parent)
    write_picture(draw_arm(found), path)
    typer.echo(path)


@app.command()
def moveit(
    arm: Annotated[str, typer.Argument(help="An arm that `servoloop arms` lists, or its folder.")],
    folder: Annotated[
        Path, typer.Argument(help="Folder for the files; what is there keeps its name with .1 behind it.")
    ],
) -> None:
    """Write MoveIt's configuration of an arm: SRDF, limits, kinematics, controllers, planners and scene.

    Example: `servoloop arms moveit so101 so101_moveit`
    """
    from servoloop.moveit.files import write_moveit

    for path in write_moveit(find_arm(arm), folder):
        typer.echo(path)


def _content(arm: Arm) -> dict[str, str]:
    """The arm for programs; files are absolute paths."""
    files = {name: str(getattr(arm, name)) for name in PATHS}
    about = {"description": arm.file.description, "source": arm.file.source, "license": arm.file.license}
    return {"name": arm.name, **about, "folder": str(arm.folder), **files}
