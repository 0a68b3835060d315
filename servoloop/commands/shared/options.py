"""Options that several commands share: the arm, its files, the network, and the permission to move."""

import os
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from commissioning.calibrate.plan import JointPlan
from drivers.driver_errors import DriverError
from hal.joint import Joint
from hal.robot_file.robot_file import RobotFile
from servoloop.commands.shared.line_options import named_devices
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.arm_options import ServoArm
from servoloop.stack.shipped_files import OWN

if TYPE_CHECKING:
    from servoloop.manual.dead_man import Keys
    from servoloop.teleop.arms import Side


@dataclass(frozen=True, slots=True)
class KnownArm:
    """Robot file of an arm, with its content, its joints and their calibration plans."""

    robot: Path
    file: RobotFile
    joints: tuple[Joint, ...]
    plans: Mapping[str, JointPlan]


def known_arm(arm: ServoArm) -> KnownArm:
    """Read the files of an arm. Raises HalError."""
    files = arm.read()
    joints = tuple(joint.between_stops() for joint in files.robot.joints)
    return KnownArm(files.robot_path, files.robot.file, joints, arm.found().file.calibration.joints)


NetworkOption = Annotated[
    bool, typer.Option("--network", help="Communicate with all machines on the network, not only this one.")
]


def set_network(network: bool) -> None:
    """Let the nodes of this process communicate with the whole network if ``network`` is set."""
    from nodes.discovery import open_to_network

    if network:
        open_to_network(os.environ)


SLOWEST_HZ: Final = 20
FASTEST_HZ: Final = 200
RATE_HZ: Final = 50
RateOption = Annotated[int, typer.Option("--rate", min=SLOWEST_HZ, max=FASTEST_HZ, help="Cycles per second.")]
HandsFreeOption = Annotated[
    bool, typer.Option("--hands-free", help="Move without a dead-man key. Keep an emergency stop within reach.")
]
UnattendedOption = Annotated[
    bool,
    typer.Option("--hands-free", "--yes", help="Move without a dead-man key. Keep an emergency stop within reach."),
]
SpeedOption = Annotated[
    float, typer.Option(min=0.05, max=1.0, help="Playback speed as a fraction of the recorded speed.")
]


def side_of(arm: str, ports: list[str]) -> "Side":
    """Return the files and devices of an arm. Raises HalError or DriverError."""
    from servoloop.teleop.arms import Side

    files = read_arm_files(find_arm(arm))
    return Side(files, named_devices(ports, files.robot.file.lines(), arm))


def saved_folder(arm: str | None, namespace: str | None) -> Path:
    """Return the folder with the poses and motions of a running arm, or of an arm whose stack does not run.

    Without ``arm``, the running arm is selected, or the default arm if no stack is running. Raises LiveError,
    ArmFileError or DriverError.
    """
    from servoloop.recording.stream import find_stack, matching, running_stacks

    if namespace is None and not matching(running_stacks(), arm, None):
        return find_arm(arm or OWN).folder
    stack = find_stack(arm, namespace)
    if stack.folder is None:
        raise DriverError(f"the folder of {stack.name} is unknown because its stack does not report it: pass --arm")
    return stack.folder


def require_keys(hands_free: bool) -> None:
    """Raise DriverError if a dead-man key is needed but stdin is not a terminal."""
    if not hands_free and not sys.stdin.isatty():
        raise DriverError(
            "no key can be held because stdin is not a terminal; run this command in a terminal or use --hands-free"
        )


@contextmanager
def permission_of(hands_free: bool, commands: Collection[str] = ()) -> "Iterator[Keys]":
    """Yield the permission to move, which is granted while a key is held, or always if ``hands_free`` is set.

    The keys in ``commands`` do not count as the dead-man key.
    """
    from servoloop.manual.dead_man import DeadMansKey, HandsFree
    from servoloop.stack.terminal import raw_keys

    if hands_free:
        yield HandsFree()
    else:
        with raw_keys():
            yield DeadMansKey(commands)
