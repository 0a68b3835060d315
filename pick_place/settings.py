"""Poses, times and names of the pick-and-place node. The defaults describe the course's robot cell.

The module imports no ROS package.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from hal.plausible import range_mistake

Pose = tuple[float, ...]

NODE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
SECONDS = ("move_time_s", "server_timeout_s", "goal_timeout_s", "result_timeout_s",
           "cancel_timeout_s", "vision_max_age_s")  # fmt: skip
"""Names of the settings that are in seconds."""


def _bins() -> dict[str, Pose]:
    return {
        "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
        "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
        "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    }


@dataclass(frozen=True, slots=True)
class ArmSettings:
    """Settings shared by both types of motion. Poses contain joint positions in rad, in the order of ``joints``. Hand
    positions are in meters."""

    joints: tuple[str, ...] = ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")
    ready_rad: Pose = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
    hand_open_m: float = 0.0
    hand_closed_m: float = 0.05
    arm_controller: str = "arm_controller"
    """Name of the trajectory controller that moves the arm."""
    hand_controller: str = "hand_controller"
    """Name of the controller that moves the fingers."""
    move_time_s: float = 2.0
    """Duration of each arm motion to joint positions, in seconds."""
    server_timeout_s: float = 2.0
    """Maximum time to wait for the arm's action server, in seconds."""
    goal_timeout_s: float = 3.0
    """Maximum time to wait until the arm accepts or rejects a goal, in seconds."""
    result_timeout_s: float = 10.0
    """Maximum time to wait for the result of a goal, in seconds."""
    cancel_timeout_s: float = 2.0
    """Maximum time to wait for confirmation that the arm has stopped, in seconds."""
    vision_max_age_s: float = 1.0
    """Age above which a vision message is ignored, in seconds."""

    def __post_init__(self) -> None:
        """Raise a ValueError that lists all errors, if any."""
        if mistakes := list(self.mistakes()):
            raise ValueError("; ".join(mistakes))

    def mistakes(self) -> Iterator[str]:
        """Yield a message for each invalid setting."""
        if not self.joints:
            yield "joints is empty: list the joints of the arm"
        yield from pose_mistakes("poses.ready", self.ready_rad, len(self.joints))
        for name in ("arm_controller", "hand_controller"):
            if not NODE_NAME.fullmatch(getattr(self, name)):
                yield f"{name} is {getattr(self, name)!r}: write the name of a controller, such as {name}"
        for name in SECONDS:
            yield from seconds_mistakes(name, getattr(self, name))
        for name in ("hand_open_m", "hand_closed_m"):
            if not math.isfinite(getattr(self, name)):
                yield f"{name} must be a finite number, in meters"
            elif mistake := range_mistake("position", getattr(self, name)):
                yield f"{name}: {mistake}"


@dataclass(frozen=True, slots=True)
class JobSettings(ArmSettings):
    """Settings of ``motion: joints``."""

    pick_rad: Pose = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
    bins_rad: Mapping[str, Pose] = field(default_factory=_bins)
    """Pose above the bin of each grade, keyed by grade (stripped, upper case)."""

    def mistakes(self) -> Iterator[str]:
        """Yield a message for each invalid setting."""
        yield from pose_mistakes("poses.pick", self.pick_rad, len(self.joints))
        for grade, pose in self.bins_rad.items():
            yield from pose_mistakes(f"bins.{grade}", pose, len(self.joints))
        yield from ArmSettings.mistakes(self)
        yield from grade_mistakes(self.bins_rad)


def normal_grade(text: str) -> str:
    """Normalize a grade for comparison: strip whitespace and convert it to upper case."""
    return text.strip().upper()


def grade_mistakes(grades: Iterable[str]) -> Iterator[str]:
    """Yield a message for each grade that cannot match any request."""
    for grade in grades:
        if grade != normal_grade(grade) or not grade:
            yield f"grade {grade!r} matches no request: write {normal_grade(grade)!r}"


def seconds_mistakes(name: str, value_s: float) -> Iterator[str]:
    """Yield a message if a setting is not a plausible positive duration."""
    if not (math.isfinite(value_s) and value_s > 0.0):
        yield f"{name} is {value_s}: it must be a positive, finite number of seconds"
    elif mistake := range_mistake("duration", value_s):
        yield f"{name}: {mistake}"


def pose_mistakes(name: str, pose: Sequence[float], joints: int) -> Iterator[str]:
    """Yield a message for each error in a pose. A pose must contain one plausible position per joint."""
    if len(pose) != joints:
        yield f"{name} has {len(pose)} numbers for {joints} joints"
    elif not all(map(math.isfinite, pose)):
        yield f"{name} contains a number that is not finite"
    else:
        yield from (f"{name}: {mistake}" for value in pose if (mistake := range_mistake("position", value)))
