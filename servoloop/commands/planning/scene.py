"""``servoloop scene``: list and change the obstacles known to the motion planner."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.driver_errors import DriverError
from drivers.printable import printable_line
from servoloop.commands.planning.planner import PoseOptions, Triple, move_group, pose_of
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import NetworkOption
from servoloop.extras import require_extras
from servoloop.stack.arm_options import NamespaceOption

if TYPE_CHECKING:
    from planning.scene import SceneObject, Shape

app = typer.Typer(no_args_is_help=True, help="List and change the obstacles that the motion planner avoids.")
FILES: Final = (".scene", ".yaml", ".yml")
"""Suffixes of scene files."""


@app.command("list")
def list_objects(network: NetworkOption = False, namespace: NamespaceOption = "") -> None:
    """List the objects in the scene with their positions in m.

    Example: `servoloop scene list`
    """
    with move_group("scene", network, namespace) as client:
        lines = [found.text() for found in client.objects()]
    for line in lines or ["the scene has no objects"]:
        typer.echo(printable_line(line))


@app.command("add")
@grouped_options
def add(
    *,
    name: Annotated[str, typer.Argument(help="Name of the object. An object of the same name is replaced.")],
    shape: Annotated[str, typer.Argument(help="box, cylinder, cone, sphere or mesh.")],
    size: Annotated[
        list[str],
        typer.Argument(
            help="Size in m: X Y Z of a box, HEIGHT RADIUS of a cylinder or cone, RADIUS of a sphere, or the FILE of "
            "a mesh."
        ),
    ],
    at: Annotated[Triple, typer.Option("--at", metavar="X Y Z", help="Position of the center in m.")],
    pose: PoseOptions,
) -> None:
    """Add an object to the scene.

    Example: `servoloop scene add shelf box 0.1 0.3 0.02 --at 0.35 0 0.3`
    """
    require_extras("servoloop scene", "planning")
    from planning.scene import Pose, SceneObject, check_object

    item = SceneObject(name, ((shape_of(shape, size), Pose()),), pose_of(at, pose.rpy))
    check_object(item)
    _add([item], pose)
    typer.echo(printable_line(f"added {name}"))


@app.command("remove")
def remove(
    name: Annotated[str, typer.Argument(help="Name of the object.")],
    network: NetworkOption = False,
    namespace: NamespaceOption = "",
) -> None:
    """Remove an object from the scene, or from the link that holds it.

    Example: `servoloop scene remove shelf`
    """
    with move_group("scene", network, namespace) as client:
        client.remove(name)
    typer.echo(printable_line(f"removed {name}"))


@app.command("load")
def load(
    file: Annotated[Path, typer.Argument(help="MoveIt .scene file or YAML file.")],
    network: NetworkOption = False,
    namespace: NamespaceOption = "",
) -> None:
    """Add the objects in a file to the scene.

    Example: `servoloop scene load bench.yaml`
    """
    require_extras("servoloop scene", "planning")
    if file.suffix.lower() not in FILES:
        raise DriverError(f"{file} is not a scene file: choose a file with the suffix {' or '.join(FILES)}")
    from planning.scene_file import read_scene_file

    items = read_scene_file(file)
    _add(items, PoseOptions(network=network, namespace=namespace))
    typer.echo(printable_line(f"added {', '.join(item.name for item in items)}"))


def _add(items: "Sequence[SceneObject]", options: PoseOptions) -> None:
    with move_group("scene", options.network, options.namespace) as client:
        from nodes.planning_client.scenes import object_message

        client.add([object_message(item, options.frame) for item in items])


def shape_of(kind: str, size: Sequence[str]) -> "Shape":
    """Return a shape from its type and its size, given as strings. Raises DriverError, or PlanningError for a mesh."""
    from planning.mesh_file import read_mesh
    from planning.scene import Box, Cone, Cylinder, Sphere

    shapes: dict[str, tuple[str, Callable[..., Shape]]] = {
        "box": ("X Y Z", Box),
        "cylinder": ("HEIGHT RADIUS", Cylinder),
        "cone": ("HEIGHT RADIUS", Cone),
        "sphere": ("RADIUS", Sphere),
        "mesh": ("FILE", lambda file: read_mesh(Path(file))),
    }
    if kind not in shapes:
        raise DriverError(f"there is no shape {kind}: choose one of {', '.join(shapes)}")
    names, shape = shapes[kind]
    if len(size) != len(names.split()):
        raise DriverError(f"the size of a {kind} must be {names}, but {len(size)} values were given")
    return shape(*(size if kind == "mesh" else map(_length, size)))


def _length(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise DriverError(f"{text} is not a length in m: use a number such as 0.1") from None
