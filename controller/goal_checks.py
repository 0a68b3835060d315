"""Why a trajectory goal may be refused, before anything moves; texts of ros2_control where it has some."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from controller.goal import GoalPoint, TrajectoryGoal
from hal.types import JointLimits

LARGEST_GOAL: Final = 5_000
"""Points of one goal: the ROS thread prepares them in some tenths of a second."""
STANDS_STILL: Final = 1.19e-7
"""Upstream's limit for a last velocity that counts as zero."""


@dataclass(frozen=True, slots=True)
class Allowed:
    """What a controller's parameters let a goal do beyond the ordinary."""

    partial: bool = False
    integration: bool = False
    moving_end: bool = False


def reason_to_reject(goal: TrajectoryGoal, joints: Sequence[str], allowed: Allowed) -> str | None:
    """Why this goal makes no sense whatever the limits, or None."""
    if not goal.points:
        return "Empty trajectory received."
    return (
        _joints_reason(goal, joints, allowed.partial)
        or _points_reason(goal, allowed.integration)
        or _times_reason(goal)
        or _not_finite(goal)
        or (None if allowed.moving_end else _end_reason(goal))
    )


def limits_reason(goal: TrajectoryGoal, joints: Sequence[str], limits: Sequence[JointLimits]) -> str | None:
    """The first point that is itself beyond a limit."""
    by_name = dict(zip(joints, limits, strict=True))
    for index, point in enumerate(goal.points):
        for name, position in zip(goal.joints, point.positions, strict=False):
            limit = by_name[name]
            if not limit.lower <= position <= limit.upper:
                return (
                    f"{name} would go to {position:.4f} at point #{index}, outside its limits "
                    f"{limit.lower:.4f} to {limit.upper:.4f}"
                )
        if reason := _too_much(goal.joints, point.velocities, lambda name: by_name[name].velocity):
            return reason.format("move", index)
        if reason := _too_much(goal.joints, point.accelerations, lambda name: by_name[name].acceleration):
            return reason.format("accelerate", index)
    return None


def _too_much(joints: Iterable[str], values: Iterable[float], bound: Callable[[str], float]) -> str | None:
    for name, value in zip(joints, values, strict=False):
        if abs(value) > bound(name):
            return f"{name} would {{}} at {value:.4f} at point #{{}}, beyond its limit {bound(name):.4f}"
    return None


def _joints_reason(goal: TrajectoryGoal, joints: Sequence[str], partial: bool) -> str | None:
    if not partial and len(goal.joints) != len(joints):
        return "Joints on incoming trajectory don't match the controller joints."
    if not goal.joints:
        return "Empty joint names on incoming trajectory."
    for name in goal.joints:
        if name not in joints:
            return f"Incoming joint {name} doesn't match the controller's joints."
        if goal.joints.count(name) > 1:  # upstream lets the last one win, and sends another joint to 0
            return f"Joint {name} is named twice: name each joint once."
    return None


def _points_reason(goal: TrajectoryGoal, integration: bool) -> str | None:
    if len(goal.points) > LARGEST_GOAL:
        return f"{len(goal.points)} points are too many: send at most {LARGEST_GOAL} in one goal"
    for index, point in enumerate(goal.points):
        if point.has_effort:
            return (
                "Trajectories with effort fields are only supported for controllers using the 'effort' "
                "command interface."
            )
        if reason := _size_reason(goal, index, point, integration):
            return reason
    return None


def _size_reason(goal: TrajectoryGoal, index: int, point: GoalPoint, integration: bool) -> str | None:
    derivatives = bool(point.velocities or point.accelerations)
    for what in ("positions", "velocities", "accelerations"):
        size = len(getattr(point, what))
        needed = what == "positions" and not (integration and derivatives)
        if size != len(goal.joints) and (size or needed):
            return f"Mismatch between joint_names size ({len(goal.joints)}) and {what} ({size}) at point #{index}."
    return None


def _times_reason(goal: TrajectoryGoal) -> str | None:
    times = [point.time_from_start_s for point in goal.points]
    for index, (before_s, time_s) in enumerate(pairwise(times)):
        if time_s <= before_s:
            return (
                f"Time between points {index} and {index + 1} is not strictly increasing, it is "
                f"{before_s:f} and {time_s:f} respectively"
            )
    end_s = times[-1] + goal.delay_s
    if goal.delay_s < 0.0 and end_s < 0.0:
        return f"Received trajectory with non-zero start time that ends in the past ({-end_s:.3f} s ago)"
    return None


def _not_finite(goal: TrajectoryGoal) -> str | None:
    for index, point in enumerate(goal.points):
        for values in (point.positions, point.velocities, point.accelerations):
            for name, value in zip(goal.joints, values, strict=False):
                if not math.isfinite(value):
                    return f"{name} is {value} at point #{index}: only finite numbers are executed"
    return None


def _end_reason(goal: TrajectoryGoal) -> str | None:
    for name, velocity in zip(goal.joints, goal.points[-1].velocities, strict=False):
        if abs(velocity) > STANDS_STILL:
            return f"Velocity of last trajectory point of joint {name} is not zero: {velocity:.15f}"
    return None
