"""Settings of ``motion: poses``: tool poses, planner parameters and the object.

The module imports no ROS package.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from hal.plausible import range_mistake
from pick_place.settings import ArmSettings, grade_mistakes, seconds_mistakes

ToolPose = tuple[float, ...]
"""Position x, y, z in m and quaternion x, y, z, w of the tool in the configured frame."""
NORMALIZED_WITHIN: Final = 1e-3
"""Maximum accepted deviation of a quaternion's length from 1. Numbers in configuration files have about five digits."""


def above(pose: ToolPose, height_m: float) -> ToolPose:
    """Return the pose raised by ``height_m``."""
    x, y, z, *quaternion = pose
    return (x, y, z + height_m, *quaternion)


@dataclass(frozen=True, slots=True)
class PickObject:
    """The object to pick, as a box in the planning scene."""

    name: str = "cube"
    """Name of the object in the scene. The object replaces any existing object with the same name."""
    size_m: tuple[float, ...] = (0.04, 0.04, 0.04)
    """Edge lengths, in m.

    The box is a few millimeters smaller than the real object, so that it does not touch the surface below.
    """
    position_m: tuple[float, ...] = (0.291, 0.0, 0.088)
    """Center of the object before picking, in m, in the configured frame."""
    touch_links: tuple[str, ...] = ("gripper_base_link", "hand_right_link", "hand_left_link")
    """Links that may touch the object while it is gripped."""

    def mistakes(self) -> Iterator[str]:
        """Yield a message for each invalid setting."""
        if not self.name:
            yield "object.name is empty: name the object"
        for name, values in (("object.size", self.size_m), ("object.position", self.position_m)):
            if len(values) != 3 or not all(map(math.isfinite, values)):
                yield f"{name} must be 3 finite numbers, in meters"
        if not all(side > 0.0 for side in self.size_m):
            yield "object.size must be positive"


def _bins() -> dict[str, ToolPose]:
    return {
        "A": (0.23148, 0.09787, 0.25935, 0.53063, 0.81882, 0.18127, 0.1229),
        "B": (0.25132, 0.0, 0.25935, 0.68273, 0.69708, 0.15324, 0.15646),
        "C": (0.23148, -0.09787, 0.25935, 0.80761, 0.54754, 0.1191, 0.18379),
    }


@dataclass(frozen=True, slots=True)
class PoseSettings(ArmSettings):
    """Settings of ``motion: poses``."""

    pick: ToolPose = (0.24894, 0.0, 0.23205, 0.69229, 0.70684, 0.10165, 0.10379)
    """Tool pose in which the open fingers surround the object."""
    bins: Mapping[str, ToolPose] = field(default_factory=_bins)
    """Tool pose above the bin for each grade, keyed by grade (stripped, upper case)."""
    frame: str = "base_link"
    """Frame of all poses."""
    group: str = "arm"
    """Planning group of the arm."""
    tool_link: str = "gripper_base_link"
    """Link to which the poses apply."""
    approach_m: float = 0.06
    """Height above the pick pose and the bins from which the tool moves straight down, in m."""
    speed: float = 0.5
    """Fraction of the arm's velocity and acceleration limits, above 0 and at most 1."""
    planning_time_s: float = 5.0
    """Maximum time to plan a motion, in seconds."""
    hand_time_s: float = 1.0
    """Time for the fingers to move before the next motion is planned, in seconds."""
    target: PickObject = field(default_factory=PickObject)

    def mistakes(self) -> Iterator[str]:
        """Yield a message for each invalid setting."""
        yield from _tool_pose_mistakes("pick.pose", self.pick)
        for grade, pose in self.bins.items():
            yield from _tool_pose_mistakes(f"bins.{grade}.pose", pose)
        yield from ArmSettings.mistakes(self)
        yield from grade_mistakes(self.bins)
        for name in ("planning_time_s", "hand_time_s"):
            yield from seconds_mistakes(name, getattr(self, name))
        if not 0.0 < self.speed <= 1.0:
            yield f"planning.speed is {self.speed}: it must be above 0 and at most 1"
        if not 0.0 < self.approach_m < math.inf:
            yield f"planning.approach_m is {self.approach_m}: it must be a positive, finite length in meters"
        for name in ("frame", "group", "tool_link"):
            if not getattr(self, name):
                yield f"planning.{name} is empty"
        yield from self.target.mistakes()


def _tool_pose_mistakes(name: str, pose: Sequence[float]) -> Iterator[str]:
    if len(pose) != 7:
        yield f"{name} has {len(pose)} numbers: give x, y, z and the quaternion x, y, z, w"
    elif not all(map(math.isfinite, pose)):
        yield f"{name} contains a number that is not finite"
    elif abs((length := math.hypot(*pose[3:])) - 1.0) > NORMALIZED_WITHIN:
        yield f"{name}: the quaternion has length {length:.4g} and must be normalized to length 1"
    else:
        yield from (f"{name}: {mistake}" for value in pose[:3] if (mistake := range_mistake("position", value)))
