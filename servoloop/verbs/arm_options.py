"""The options by which verbs are told which arm it is, and what they then know of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from commissioning.calibrate.plan import JointPlan
from hal.joint import Joint
from hal.robot_file.robot_file import RobotFile
from servoloop.arms.folder import find_arm, read_arm_servos

ArmOption = Annotated[str, typer.Option("--arm", help="The arm: a name that `servoloop arms` lists, or its folder.")]
RobotOption = Annotated[Path | None, typer.Option("--robot", help="Robot file instead of the arm's.")]
UrdfOption = Annotated[Path | None, typer.Option("--urdf", help="Robot description instead of the arm's.")]

BacklashOption = Annotated[
    float, typer.Option("--backlash", min=0.0, max=10.0, help="Degrees by which each virtual servo's shaft is free.")
]
SeedOption = Annotated[
    int | None,
    typer.Option("--seed", min=0, help="A virtual arm of its own: friction, motors, masses and supply differ by 10 %."),
]
BACKLASH_DEG = 1.0
"""What owners measure at the shaft of an STS3215."""


@dataclass(frozen=True, slots=True)
class KnownArm:
    """An arm's robot file, what is in it, and how its joints are calibrated."""

    robot: Path
    file: RobotFile
    joints: tuple[Joint, ...]
    plans: Mapping[str, JointPlan]


def known_arm(arm: str, urdf: Path | None = None, robot: Path | None = None) -> KnownArm:
    """Read an arm's files; single files count more. Raises HalError."""
    found = find_arm(arm)
    files = read_arm_servos(found, urdf, robot)
    joints = tuple(joint.between_stops() for joint in files.robot.joints)
    return KnownArm(files.robot_path, files.robot.file, joints, found.file.calibration.joints)
