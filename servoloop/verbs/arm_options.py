"""The options by which verbs are told which arm it is."""

from pathlib import Path
from typing import Annotated

import typer

from hal.joint import Joint
from servoloop.files import CONTROLLERS, read_files

RobotOption = Annotated[Path | None, typer.Option("--robot", help="Robot file; by default the one the URDF names.")]
UrdfOption = Annotated[Path, typer.Option("--urdf", help="Robot description.")]
JsonOption = Annotated[bool, typer.Option("--json", help="JSON instead of a table.")]


def read_arm(urdf: Path, robot: Path | None) -> tuple[Path, tuple[Joint, ...]]:
    """The robot file and its joints. Raises HalError."""
    files = read_files(urdf, CONTROLLERS, robot)
    return files.robot_path, files.robot.joints
