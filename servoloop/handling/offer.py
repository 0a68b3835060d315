"""What a page offers to do with an arm: which joints turn, where the hand opens, which poses there are."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from hal.errors import ArmFileError
from hal.types import JointLimits
from servoloop.arms.folder import read_arm
from servoloop.arms.pick_place import load_pick_place
from servoloop.arms.pick_place_check import HAND
from servoloop.handling.poses import PoseError, Poses, check

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
