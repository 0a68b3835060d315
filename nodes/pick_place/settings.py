"""Poses, times and names of the pick-and-place node. The defaults describe the course's robot cell. No ROS imports."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from hal.plausible import range_mistake

Pose = tuple[float, ...]


def _bins() -> dict[str, Pose]:
    return {
        "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
        "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
        "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    }


@dataclass(frozen=True, slots=True)
class JobSettings:
    """Settings of the node. Poses are in rad in the order of ``joints``. Hand positions are in meters; 0 is open."""

    joints: tuple[str, ...] = ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")
    ready_rad: Pose = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
    pick_rad: Pose = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
    bins_rad: Mapping[str, Pose] = field(default_factory=_bins)
    """Pose above the bin of each grade, by grade (stripped, upper case)."""
    hand_open_m: float = 0.0
    hand_closed_m: float = 0.05
    move_time_s: float = 2.0
    """Duration of each arm motion, in seconds."""
    server_timeout_s: float = 2.0
    """Maximum wait for the action server of the arm, in seconds."""
    goal_timeout_s: float = 3.0
    """Maximum wait until the arm accepts or rejects a goal, in seconds."""
    result_timeout_s: float = 10.0
    """Maximum wait for the result of a goal, in seconds."""
    cancel_timeout_s: float = 2.0
    """Maximum wait for the confirmation that the arm has stopped, in seconds."""
    vision_max_age_s: float = 1.0
    """Age from which a vision message is ignored, in seconds."""

    def __post_init__(self) -> None:
        mistakes = list(_mistakes(self))
        if mistakes:
            raise ValueError("; ".join(mistakes))


def normal_grade(text: str) -> str:
    """Normalize a grade for comparison: strip whitespace and convert it to upper case."""
    return text.strip().upper()


def _mistakes(settings: JobSettings) -> Iterator[str]:
    if not settings.joints:
        yield "joints is empty: list the joints of the arm"
    poses = {"poses.ready": settings.ready_rad, "poses.pick": settings.pick_rad}
    poses |= {f"bins.{grade}": pose for grade, pose in settings.bins_rad.items()}
    for name, pose in poses.items():
        yield from _pose_mistakes(name, pose, len(settings.joints))
    for name in ("move_time_s", "server_timeout_s", "goal_timeout_s", "result_timeout_s",
                 "cancel_timeout_s", "vision_max_age_s"):  # fmt: skip
        value_s = getattr(settings, name)
        if not (math.isfinite(value_s) and value_s > 0.0):
            yield f"{name} is {value_s}: it must be a positive, finite number of seconds"
        elif mistake := range_mistake("duration", value_s):
            yield f"{name}: {mistake}"
    for name in ("hand_open_m", "hand_closed_m"):
        if not math.isfinite(getattr(settings, name)):
            yield f"{name} must be a finite number, in meters"
        elif mistake := range_mistake("position", getattr(settings, name)):
            yield f"{name}: {mistake}"
    for grade in settings.bins_rad:
        if grade != normal_grade(grade) or not grade:
            yield f"grade {grade!r} matches no request: write {normal_grade(grade)!r}"


def _pose_mistakes(name: str, pose: Sequence[float], joints: int) -> Iterator[str]:
    if len(pose) != joints:
        yield f"{name} has {len(pose)} numbers for {joints} joints"
    elif not all(map(math.isfinite, pose)):
        yield f"{name} contains a number that is not finite"
    else:
        yield from (f"{name}: {mistake}" for value in pose if (mistake := range_mistake("position", value)))
