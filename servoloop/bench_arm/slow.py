"""How a bench moves an arm: with a quarter of its speed, joint by joint, and back to where it lay."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from commissioning.slow_arm import SPEED_SHARE
from hal.robot_file.robot_file import ExitFile, ParkFile
from hal.types import JointLimits
from servoloop.arms.pick_place import PickPlace
from servoloop.files import Files

Pose = Mapping[str, float]
"""rad or m by joint."""
WAY: Final = 0.3
"""How far each joint turns there and back, rad or m, where a quarter of its range is not less."""


def slow(files: Files, back_to: Pose | None = None) -> Files:
    """The files with a quarter of the velocity limits, which controllers plan with and the safety gate holds.

    ``back_to``: where the arm goes when the stack ends (rad or m by joint), to be let go there.
    """
    limits = {name: replace(one, velocity=SPEED_SHARE * one.velocity) for name, one in files.limits.items()}
    if back_to is None:
        return replace(files, limits=limits)
    ending = {"park": ParkFile(pose=dict(back_to), velocity_scale=1.0), "on_exit": ExitFile(virtual="relax")}
    robot = replace(files.robot, file=files.robot.file.model_copy(update=ending))
    return replace(files, limits=limits, robot=robot)


def bench_poses(pick_place: PickPlace, limits: Mapping[str, JointLimits]) -> list[Pose]:
    """The arm's ready pose, and from there each joint a little towards its middle and back."""
    ready = dict(zip(pick_place.joints, pick_place.poses.ready, strict=True))
    poses: list[Pose] = [ready]
    for joint, position in ready.items():
        poses += [{**ready, joint: position + _way(position, limits[joint])}, ready]
    return poses


def _way(position: float, limits: JointLimits) -> float:
    way = min(WAY, 0.25 * (limits.upper - limits.lower))
    return way if position < 0.5 * (limits.lower + limits.upper) else -way


def seconds_for(start: Pose, end: Pose, limits: Mapping[str, JointLimits]) -> float:
    """The time for a motion that stays well within the joints' velocity limits."""
    return 0.6 + max(1.4 * abs(position - start[joint]) / limits[joint].velocity for joint, position in end.items())
