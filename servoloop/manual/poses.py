"""Named poses of an arm: the YAML file in the arm's folder, and the poses to which a running arm can move."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import yaml
from pydantic import BaseModel, ConfigDict, Field

from commissioning.atomic_write import write_whole
from drivers.driver_errors import DriverError
from hal.hal_errors import ArmFileError, HalError
from hal.plausible import Position
from hal.robot_description.description import Description
from hal.types import JointLimits
from hal.yaml_file import load
from hal.yaml_nodes import compose
from servoloop.stack.arm_folders import read_arm
from servoloop.stack.pick_place import load_pick_places
from servoloop.stack.robot_files import read_description

FILE: Final = "poses.yaml"
LONGEST_NAME: Final = 100
"""Maximum length of a pose name, in characters."""


class PoseError(DriverError):
    """A pose does not exist or does not match the arm."""


class PosesFile(BaseModel):
    """Contents of the pose file: joint positions in rad or m, keyed by pose name and joint name."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    poses: dict[str, dict[str, Position]] = Field(default_factory=dict)


class Poses:
    """Saved poses of one arm. The methods raise PoseError if the file is invalid or cannot be read or written."""

    def __init__(self, folder: Path) -> None:
        """Open the pose file in an arm's folder."""
        self.path = folder / FILE

    def all(self) -> dict[str, dict[str, float]]:
        """Return all poses, keyed by name."""
        return load(self.path, PosesFile, PoseError).poses if self.path.exists() else {}

    def get(self, name: str) -> dict[str, float]:
        """Return a pose. Raises PoseError if there is no pose with this name."""
        poses = self.all()
        if name not in poses:
            known = f"the saved poses are: {', '.join(poses)}" if poses else "no poses are saved"
            raise PoseError(f"there is no pose {name} in {self.path}; {known}")
        return poses[name]

    def check(self, name: str, limits: Mapping[str, JointLimits]) -> None:
        """Check that a pose is within the given joint limits. Raises PoseError with the file and line."""
        try:
            check(self.get(name), limits)
        except PoseError as error:
            place = compose(self.path, PoseError).place(("poses", name))
            raise PoseError(f"{place}: pose {name}: {error}") from error

    def save(self, name: str, pose: Mapping[str, float]) -> None:
        """Save a pose, replacing any pose with this name."""
        if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
            raise PoseError(
                f"{name[:LONGEST_NAME]!r} is not a valid pose name; use 1 to {LONGEST_NAME} printable characters"
            )
        self._write(self.all() | {name: dict(pose)})

    def remove(self, name: str) -> None:
        """Remove a pose."""
        self.get(name)
        self._write({other: pose for other, pose in self.all().items() if other != name})

    def _write(self, poses: Mapping[str, Mapping[str, float]]) -> None:
        try:
            write_whole(self.path, yaml.safe_dump({"poses": dict(poses)}, sort_keys=False))
        except OSError as error:
            raise PoseError(f"cannot write {self.path}: {error.strerror}") from error


def check(pose: Mapping[str, float], limits: Mapping[str, JointLimits]) -> None:
    """Check that all joints of a pose exist and are within their limits. Raises PoseError that lists all problems."""
    problems = [f"the arm has no joint {joint}" for joint in pose if joint not in limits]
    for joint, at in pose.items():
        limit = limits.get(joint)
        if limit is not None and not limit.lower <= at <= limit.upper:
            problems.append(f"{joint}: {at:.4f} is outside its limits {limit.lower:.4f} to {limit.upper:.4f}")
    if problems:
        raise PoseError("; ".join(problems))


def inside(pose: Mapping[str, float], limits: Mapping[str, JointLimits]) -> tuple[dict[str, float], list[str]]:
    """Return a measured pose, clipped to the joint limits, and a warning for each joint that was beyond its limits."""
    clipped: dict[str, float] = {}
    warnings: list[str] = []
    for joint, at in pose.items():
        limit = limits.get(joint)
        clipped[joint] = at if limit is None else min(max(at, limit.lower), limit.upper)
        if clipped[joint] != at:
            warnings.append(f"{joint} was measured at {at:.4f} and is saved at its limit {clipped[joint]:.4f}")
    return clipped, warnings


def pose_problems(folder: Path) -> list[str]:
    """Return all problems in the pose file of an arm. Poses are not compared with a URDF that cannot be read."""
    poses = Poses(folder)
    problems: list[str] = []
    try:
        names = list(poses.all())
        limits = _urdf_limits(read_description(read_arm(folder).urdf))
    except PoseError as error:
        return str(error).splitlines()
    except HalError:
        return []
    for name in names:
        try:
            poses.check(name, limits)
        except PoseError as error:
            problems.append(str(error))
    return problems


def _urdf_limits(description: Description) -> dict[str, JointLimits]:
    return {
        name: JointLimits(joint.lower, joint.upper, joint.velocity, math.inf, math.inf)
        for name, joint in description.joints.items()
        if joint.kind != "fixed"
    }


Pose = Mapping[str, float]
OPEN, CLOSE = "open the hand", "close the hand"


@dataclass(frozen=True, slots=True)
class MoveTargets:
    """Joints that can be moved, and poses to which the arm can move."""

    joints: tuple[str, ...] = ()
    hand: Mapping[str, Pose] = field(default_factory=dict)
    """Poses of the open and the closed hand, or empty if the arm's files do not specify the hand joint."""
    poses: Mapping[str, Pose] = field(default_factory=dict)
    """Saved poses, in rad or m, keyed by joint name."""
    refused: tuple[str, ...] = ()
    """Reasons why saved poses are not available."""


NO_TARGETS: Final = MoveTargets()


def find_targets(
    folder: Path | None, driven: Mapping[str, tuple[str, ...]], limits: Mapping[str, JointLimits]
) -> MoveTargets:
    """Return the joints that a running arm can move and the poses to which it can move.

    Args:
        folder: Folder of the arm, or None if the stack does not report the folder.
        driven: Joints of each active controller, keyed by controller name.
        limits: Limits of each joint.
    """
    joints = tuple(joint for some in driven.values() for joint in some)
    if folder is None:
        return MoveTargets(
            joints, refused=("No poses are available because the stack does not report its arm's folder.",)
        )
    hand = _hand(folder, driven)
    try:
        poses = Poses(folder).all()
    except PoseError as error:
        return MoveTargets(joints, hand, refused=(f"No poses are available: {error}",))
    refused = {pose: why for pose, at in poses.items() if (why := _refusal(at, joints, limits))}
    available = {pose: at for pose, at in poses.items() if pose not in refused}
    return MoveTargets(
        joints, hand, available, tuple(f"{pose} is not available: {why}" for pose, why in refused.items())
    )


def _hand(folder: Path, driven: Mapping[str, tuple[str, ...]]) -> Mapping[str, Pose]:
    """Return the poses in which all hands are open or closed, or no poses if the arm's files do not define them."""
    try:
        jobs = load_pick_places(read_arm(folder).pick_place).values()
    except ArmFileError:  # the folder contains only a URDF, or the arm has no pick-and-place parameters
        return {}
    hands = [(joints[0], job) for job in jobs if len(joints := driven.get(job.hand_controller, ())) == 1]
    if not hands:
        return {}
    return {
        OPEN: {joint: job.hand_open_m for joint, job in hands},
        CLOSE: {joint: job.hand_closed_m for joint, job in hands},
    }


def _refusal(pose: Pose, joints: tuple[str, ...], limits: Mapping[str, JointLimits]) -> str:
    if missing := [joint for joint in pose if joint in limits and joint not in joints]:
        return f"no active controller moves {', '.join(missing)}"
    try:
        check(pose, limits)
    except PoseError as error:
        return str(error)
    return ""
