"""Options that select an arm and its files, as dataclass fields shared by the commands."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.driver_errors import DriverError
from nodes.namespace import parse_namespace
from servoloop.stack.shipped_files import OWN

if TYPE_CHECKING:
    from servoloop.stack.arm_folders import ArmFolder
    from servoloop.stack.robot_files import Files, ServoFiles

ArmOption = Annotated[str, typer.Option("--arm", help="Arm: a name that `servoloop arms` lists, or an arm folder.")]
RobotOption = Annotated[Path | None, typer.Option("--robot", help="Robot file to use instead of the arm's own.")]
UrdfOption = Annotated[
    Path | None,
    typer.Option(
        "--urdf", help="URDF file to use instead of the arm's own. A file whose name ends in .xacro is expanded."
    ),
]
XacroOption = Annotated[
    list[str] | None,
    typer.Option("--xacro-arg", metavar="NAME:=VALUE", help="xacro argument for the --urdf file. Repeatable."),
]
BacklashOption = Annotated[
    float, typer.Option("--backlash", min=0.0, max=10.0, help="Backlash of each virtual servo, in degrees.")
]
SeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed",
        min=0,
        help="Seed for random variations of up to 10 % in friction, motors, masses and supply of the virtual arm.",
    ),
]


def _checked_namespace(text: str | None) -> str | None:
    """Return the absolute namespace, or None if the option is not given. Raises typer.BadParameter."""
    try:
        return None if text is None else parse_namespace(text)
    except DriverError as error:
        raise typer.BadParameter(str(error)) from error


NamespaceOption = Annotated[
    str,
    typer.Option(
        "--namespace",
        metavar="NAME",
        callback=_checked_namespace,
        help="Namespace of all ROS nodes, so that several stacks can share one ROS domain.",
    ),
]
RunningArm = Annotated[
    str | None, typer.Option("--arm", help="Name, folder or process ID of the arm if several are running.")
]
SavedArm = Annotated[
    str | None,
    typer.Option(
        "--arm", help=f"Name, folder or process ID of the arm (default: the running arm, or {OWN} if none is running)."
    ),
]
RunningNamespace = Annotated[
    str | None,
    typer.Option(
        "--namespace",
        metavar="NAME",
        callback=_checked_namespace,
        help="ROS namespace of the running arm if several are running.",
    ),
]


@dataclass(frozen=True, slots=True)
class RunningChoice:
    """Options that choose a running arm. The value None matches any arm or namespace."""

    arm: str | None = None
    namespace: str | None = None


BACKLASH_DEG: Final = 1.0
"""Typical backlash at the shaft of an STS3215, as measured by users, in degrees."""


def xacro_arguments(texts: Sequence[str] | None) -> dict[str, str]:
    """Parse the values of ``--xacro-arg``. Raises DriverError."""
    arguments: dict[str, str] = {}
    for text in texts or ():
        name, separator, value = text.partition(":=")
        if not separator or not name:
            raise DriverError(f"--xacro-arg must be NAME:=VALUE, such as prefix:=left_, not {text!r}")
        arguments[name] = value
    return arguments


@dataclass(frozen=True, slots=True)
class ServoArm:
    """Arm whose servos a command uses, with the files that replace the arm's own."""

    arm: ArmOption = OWN
    robot: RobotOption = None
    urdf: UrdfOption = None
    xacro_arg: XacroOption = None

    def found(self) -> "ArmFolder":
        """Return the folder of the arm. Raises ArmFileError."""
        from servoloop.stack.arm_folders import find_arm

        return find_arm(self.arm)

    def read(self) -> "ServoFiles":
        """Read and check the files of the arm, except for its controllers file. Raises HalError."""
        from servoloop.stack.arm_folders import read_arm_servos

        return read_arm_servos(self.found(), self.urdf, self.robot, xacro_arguments(self.xacro_arg))


@dataclass(frozen=True, slots=True)
class ControlledArm:
    """Arm that the control stack moves, with the files that replace the arm's own."""

    arm: ArmOption = OWN
    controllers: Annotated[
        Path | None, typer.Option(help="Controllers file (ros2_control format) to use instead of the arm's own.")
    ] = None
    urdf: UrdfOption = None
    robot: RobotOption = None
    xacro_arg: XacroOption = None
    namespace: NamespaceOption = ""

    def read(self) -> "Files":
        """Read and check the files of the arm. Raises HalError or ControllersFileError."""
        from servoloop.stack.arm_folders import find_arm, read_arm_files

        arguments = xacro_arguments(self.xacro_arg)
        return read_arm_files(find_arm(self.arm), self.urdf, self.controllers, self.robot, arguments, self.namespace)
