"""Read launch files with the replacements in recorders.py, and return the actions that the files would start."""

from pathlib import Path
from runpy import run_path
from typing import Any

import typer

from tests.launch.recorders import (
    DeclareLaunchArgument,
    ExecuteProcess,
    IncludeLaunchDescription,
    LaunchContext,
    LaunchDescription,
    Node,
    OpaqueFunction,
)

CONTROL = "robot_arm_ros2_control.launch.py"
MOVEIT = "robot_arm_moveit_with_control.launch.py"


def actions(file: Path, **arguments: str) -> list[Any]:
    """Return the actions of `ros2 launch FILE name:=value…`, with those of included files first."""
    return carried_out(file, LaunchContext(dict(arguments)))


def carried_out(file: Path, context: LaunchContext) -> list[Any]:
    description: LaunchDescription = run_path(str(file))["generate_launch_description"]()
    found: list[Any] = []
    for entity in description.entities:
        if isinstance(entity, DeclareLaunchArgument):
            context.launch_configurations.setdefault(entity.name, entity.default_value)
        elif isinstance(entity, IncludeLaunchDescription):
            found += carried_out(Path(entity.launch_description_source.location), context)
        elif isinstance(entity, OpaqueFunction):
            found += entity.function(context)
        else:
            found.append(entity)
    return [
        action for action in found if getattr(action, "condition", None) is None or action.condition.evaluate(context)
    ]


def words(process: ExecuteProcess | Node, workspace: Path) -> list[str]:
    """Return the command line of one of our programs."""
    if isinstance(process, Node):
        assert process.package == "servoloop"
        files = [word for file in process.parameters for word in ("--params-file", file)]
        return [str(workspace / "lib" / "servoloop" / process.executable), "--ros-args", *files]
    program, *rest = process.cmd
    assert program.package == "servoloop"
    return [str(workspace / "lib" / "servoloop" / program.executable), *rest]


def parse(arguments: list[str]) -> dict[str, Any]:
    """Return the parsed arguments of `servoloop up`. Raise an error for unknown arguments."""
    from servoloop.cli import app

    assert arguments[0] == "up"
    group: Any = typer.main.get_command(app)
    parsed: dict[str, Any] = group.commands["up"].make_context("up", arguments[1:]).params
    return parsed
