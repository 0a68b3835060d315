"""Poses with names: a YAML file beside the arm's other files."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import yaml
from pydantic import BaseModel, ConfigDict, Field

from commissioning.atomic_write import write_whole
from drivers.errors import DriverError
from hal.errors import ArmFileError
from hal.plausible import Position
from hal.types import JointLimits
from hal.yaml_file import load
from hal.yaml_nodes import compose
from servoloop.stack.arm_folders import read_arm
from servoloop.stack.pick_place import HAND, load_pick_place

FILE: Final = "poses.yaml"
LONGEST_NAME: Final = 100
"""Characters of a pose's name."""


class PoseError(DriverError):
    """A pose is not there, or not one of this arm."""


class PosesFile(BaseModel):
    """The whole file: joint positions in rad or m, by the pose's name and the joint's."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    poses: dict[str, dict[str, Position]] = Field(default_factory=dict)


class Poses:
    """The poses of one arm. Raises PoseError where the file is wrong, or cannot be read or written."""

    def __init__(self, folder: Path) -> None:
        """``folder``: the arm's."""
        self.path = folder / FILE

    def all(self) -> dict[str, dict[str, float]]:
        """All poses by name."""
        return load(self.path, PosesFile, PoseError).poses if self.path.exists() else {}

    def get(self, name: str) -> dict[str, float]:
        """One pose."""
        poses = self.all()
        if name not in poses:
            known = ", ".join(poses) or "none yet"
            raise PoseError(f"there is no pose {name} in {self.path}, but: {known}")
        return poses[name]

    def check(self, name: str, limits: Mapping[str, JointLimits]) -> None:
        """Check that a robot with these limits has the pose. Raises PoseError with file and line."""
        try:
            check(self.get(name), limits)
        except PoseError as error:
            place = compose(self.path, PoseError).place(("poses", name))
            raise PoseError(f"{place}: pose {name}: {error}") from error

    def save(self, name: str, pose: Mapping[str, float]) -> None:
        """Keep a pose; one of the same name is replaced."""
        if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
            raise PoseError(
                f"{name[:LONGEST_NAME]!r} is not a name for a pose: use 1 to {LONGEST_NAME} printable characters"
            )
        self._write(self.all() | {name: {joint: round(at, 4) for joint, at in pose.items()}})

    def remove(self, name: str) -> None:
        """Forget a pose."""
        self.get(name)
        self._write({other: pose for other, pose in self.all().items() if other != name})

    def _write(self, poses: Mapping[str, Mapping[str, float]]) -> None:
        try:
            write_whole(self.path, yaml.safe_dump({"poses": dict(poses)}, sort_keys=False))
        except OSError as error:
            raise PoseError(f"cannot write {self.path}: {error.strerror}") from error


def check(pose: Mapping[str, float], limits: Mapping[str, JointLimits]) -> None:
    """Check that a robot with these limits has the pose. Raises PoseError with all that is wrong."""
    wrong = [f"the arm has no {joint}" for joint in pose if joint not in limits]
    for joint, at in pose.items():
        limit = limits.get(joint)
        if limit is not None and not limit.lower <= at <= limit.upper:
            wrong.append(f"{joint} would go to {at:.4f}, its limits are {limit.lower:.4f} to {limit.upper:.4f}")
    if wrong:
        raise PoseError("; ".join(wrong))


Pose = Mapping[str, float]
OPEN, CLOSE = "open the hand", "close the hand"


@dataclass(frozen=True, slots=True)
class Offer:
    """Joints by name; poses in rad or m by joint."""

    joints: tuple[str, ...] = ()
    hand: Mapping[str, Pose] = field(default_factory=dict)
    """Empty where the arm's files do not say which joint is the hand's."""
    poses: Mapping[str, Pose] = field(default_factory=dict)
    refused: tuple[str, ...] = ()
    """Why poses of the arm are not offered."""


NOTHING: Final = Offer()


def offer(folder: Path | None, driven: Mapping[str, tuple[str, ...]], limits: Mapping[str, JointLimits]) -> Offer:
    """The offer of a running arm with this folder, with these active controllers and their joints."""
    joints = tuple(joint for some in driven.values() for joint in some)
    if folder is None:
        return Offer(joints, refused=("no poses: the stack does not tell its arm's folder",))
    hand = _hand(folder, driven)
    try:
        poses = Poses(folder).all()
    except PoseError as error:
        return Offer(joints, hand, refused=(f"no poses: {error}",))
    wrong = {pose: why for pose, at in poses.items() if (why := _wrong(at, joints, limits))}
    fitting = {pose: at for pose, at in poses.items() if pose not in wrong}
    return Offer(joints, hand, fitting, tuple(f"not {pose}: {why}" for pose, why in wrong.items()))


def _hand(folder: Path, driven: Mapping[str, tuple[str, ...]]) -> Mapping[str, Pose]:
    joints = driven.get(HAND, ())
    if len(joints) != 1:
        return {}
    try:
        said = load_pick_place(read_arm(folder).pick_place)
    except ArmFileError:  # a robot description without an arm's files, or an arm that does not pick and place
        return {}
    return {OPEN: {joints[0]: said.hand_open_m}, CLOSE: {joints[0]: said.hand_closed_m}}


def _wrong(pose: Pose, joints: tuple[str, ...], limits: Mapping[str, JointLimits]) -> str:
    if missing := [joint for joint in pose if joint in limits and joint not in joints]:
        return f"no active controller moves {', '.join(missing)}"
    try:
        check(pose, limits)
    except PoseError as error:
        return str(error)
    return ""
