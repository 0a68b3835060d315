"""Options that name an arm and its files, as fields of the dataclasses that commands take."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from servoloop.stack.arm_folders import OWN, ArmFolder, find_arm, read_arm_files, read_arm_servos
from servoloop.stack.robot_files import Files, ServoFiles

ArmOption = Annotated[str, typer.Option("--arm", help="Arm: a name that `servoloop arms` lists, or an arm folder.")]
RobotOption = Annotated[Path | None, typer.Option("--robot", help="Robot file to use instead of the arm's own.")]
UrdfOption = Annotated[Path | None, typer.Option("--urdf", help="URDF file to use instead of the arm's own.")]
BacklashOption = Annotated[
    float, typer.Option("--backlash", min=0.0, max=10.0, help="Backlash of each virtual servo, in degrees.")
]
SeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed", min=0, help="Seed that varies friction, motors, masses and supply of the virtual arm by up to 10 %."
    ),
]
BACKLASH_DEG: Final = 1.0
"""Typical backlash that users measure at the shaft of an STS3215, in degrees."""


@dataclass(frozen=True, slots=True)
class ServoArm:
    """Arm whose servos a command uses, and the files that replace the arm's own."""

    arm: ArmOption = OWN
    robot: RobotOption = None
    urdf: UrdfOption = None

    def found(self) -> ArmFolder:
        """Return the folder of the arm. Raises ArmFileError."""
        return find_arm(self.arm)

    def read(self) -> ServoFiles:
        """Read and check the files of the arm, except for its controllers file. Raises HalError."""
        return read_arm_servos(self.found(), self.urdf, self.robot)


@dataclass(frozen=True, slots=True)
class ControlledArm:
    """Arm that the control stack moves, and the files that replace the arm's own."""

    arm: ArmOption = OWN
    controllers: Annotated[
        Path | None, typer.Option(help="Controllers file (ros2_control format) to use instead of the arm's own.")
    ] = None
    urdf: UrdfOption = None
    robot: RobotOption = None

    def read(self) -> Files:
        """Read and check the files of the arm. Raises HalError or ControllersFileError."""
        return read_arm_files(find_arm(self.arm), self.urdf, self.controllers, self.robot)
