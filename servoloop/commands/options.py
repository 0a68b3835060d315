"""The options by which verbs are told which arm it is, and what they then know of it."""

import os
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from commissioning.calibrate.plan import JointPlan
from drivers.errors import DriverError
from hal.joint import Joint
from hal.robot_file.robot_file import RobotFile
from servoloop.commands.line_options import named_devices
from servoloop.stack.arm_folders import find_arm, read_arm_files, read_arm_servos

if TYPE_CHECKING:
    from servoloop.manual.dead_man import Keys
    from servoloop.teleop.arms import Side


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


NetworkOption = Annotated[bool, typer.Option("--network", help="Not only this machine: the whole network.")]


def set_network(network: bool) -> None:
    """Let nodes of this process talk to the whole network, where it is wanted."""
    from nodes.discovery import open_to_network

    if network:
        open_to_network(os.environ)


SLOWEST_HZ, FASTEST_HZ = 20, 200
RATE_HZ: Final = 50
RateOption = Annotated[int, typer.Option("--rate", min=SLOWEST_HZ, max=FASTEST_HZ, help="Cycles a second.")]
HandsFreeOption = Annotated[
    bool, typer.Option("--hands-free", help="Move without a key that is held: have an emergency stop at hand.")
]
UnattendedOption = Annotated[
    bool,
    typer.Option("--hands-free", "--yes", help="Do not ask for a key that is held: have an emergency stop at hand."),
]
SpeedOption = Annotated[
    float, typer.Option(min=0.05, max=1.0, help="Share of the speed of the hand, or of the recording.")
]


def side_of(arm: str, port: str) -> "Side":
    """An arm's files and its devices. Raises errors that say what to do."""
    from servoloop.teleop.arms import Side

    files = read_arm_files(find_arm(arm))
    return Side(files, named_devices(port.split(","), files.robot.file.lines(), arm))


def require_keys(hands_free: bool) -> None:
    """Raise DriverError where no key could ever be held."""
    if not hands_free and not sys.stdin.isatty():
        raise DriverError("nobody can hold a key here, stdin is no terminal: run it in one, or say --hands-free")


@contextmanager
def permission_of(hands_free: bool, commands: Collection[str] = ()) -> "Iterator[Keys]":
    """The permission to move: a key of this terminal that is held, or always. ``commands``: keys that are none."""
    from servoloop.manual.dead_man import DeadMansKey, HandsFree
    from servoloop.stack.terminal import raw_keys

    if hands_free:
        yield HandsFree()
    else:
        with raw_keys():
            yield DeadMansKey(commands)
