"""Define a trajectory goal and its handle, and check goals before the arm moves.

If ros2_control performs the same check, the rejection message is the same.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from controller.action_goals import GoalStatus
from controller.trajectory.goal_result import ErrorCode
from controller.trajectory.tolerances import Tolerances
from hal.types import AT_LIMIT, FloatArray, JointLimits, apart, beyond_range

LARGEST_GOAL: Final = 5_000
"""Maximum number of points in one goal. The ROS thread prepares this many points in a few tenths of a second."""
LONGEST_GOAL_S: Final = 3_600.0
"""Maximum time (s) to the end of a goal. Planners build tables over time, and a later end usually indicates a wrong
stamp.
"""
MOST_NAMES: Final = 20
"""Maximum number of joint names in a rejection message."""
LONGEST_NAME: Final = 100
"""Maximum number of characters of a joint name in a rejection message."""
ROUNDING: Final = 1e-6
"""Fraction by which a value may exceed a limit. Planners use the full limits and have rounding errors (MoveIt:
1e-13)."""
STANDS_STILL: Final = 1.19e-7
"""Maximum final velocity that counts as zero, as in ros2_control."""


@dataclass(frozen=True, slots=True)
class GoalPoint:
    """One waypoint, in the client's joint order. Times are in seconds from the start of the trajectory."""

    positions: tuple[float, ...]
    time_from_start_s: float
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()
    has_effort: bool = False


@dataclass(frozen=True, slots=True)
class TrajectoryGoal:
    """A goal from a client. ``delay_s`` is the goal's stamp relative to the current time; 0 means now."""

    joints: tuple[str, ...]
    points: tuple[GoalPoint, ...]
    tolerances: Tolerances = field(default_factory=Tolerances)
    delay_s: float = 0.0
    from_topic: bool = False
    """Whether the goal was received on the topic, so that no client is waiting for its result."""
    next_cycle_s: float = 0.0
    """Time from now to the cycle in which the goal can start, in seconds."""
    begins_s: float | None = None
    """Time of the cycle in which the goal can start, on the loop's clock, in seconds. None means that the goal is never
    considered late.
    """

    @property
    def starts_s(self) -> float:
        """Start of the trajectory relative to the cycle in which the goal can start, in seconds."""
        return self.delay_s - self.next_cycle_s if self.delay_s else 0.0


class GoalHandle:
    """An accepted goal. The loop thread decides its result, and any thread may read it."""

    def __init__(self, goal: TrajectoryGoal) -> None:
        self.goal = goal
        self.status = GoalStatus.EXECUTING
        self.error_code = ErrorCode.SUCCESSFUL
        self.error_text = ""

    @property
    def done(self) -> bool:
        """Whether the goal has a result."""
        return self.status is not GoalStatus.EXECUTING

    def decide(self, status: GoalStatus, error_code: int, text: str) -> None:
        """Set the result, unless the goal already has one. Other threads poll the status, so it is set last."""
        if not self.done:
            self.error_code, self.error_text = error_code, text
            self.status = status


@dataclass(frozen=True, slots=True)
class Allowed:
    """Special types of goals that a controller's parameters allow."""

    partial: bool = False
    integration: bool = False
    moving_end: bool = False


def reason_to_reject(goal: TrajectoryGoal, joints: Sequence[str], allowed: Allowed) -> str | None:
    """Return the reason why a goal is invalid regardless of the joint limits, or None."""
    if not goal.points:
        return "Empty trajectory received."
    return (
        _joints_reason(goal, joints, allowed.partial)
        or _points_reason(goal, allowed.integration)
        or _times_reason(goal)
        or _not_finite(goal)
        or (None if allowed.moving_end else _end_reason(goal))
    )


def limits_reason(
    goal: TrajectoryGoal, joints: Sequence[str], limits: Sequence[JointLimits], stands: Sequence[FloatArray] = ()
) -> str | None:
    """Describe the first point that exceeds a limit, or return None if all points are within the limits.

    ``stands`` contains the measured and the commanded positions (n,) of the joints. A joint that is at or beyond a
    limit may start from its current position. The plan moves points beyond a limit to that limit.
    """
    by_name = dict(zip(joints, limits, strict=True))
    ends = {name: _ends(by_name[name], [float(at[i]) for at in stands]) for i, name in enumerate(joints)}
    for index, point in enumerate(goal.points):
        for name, position in zip(goal.joints, point.positions, strict=False):
            if not ends[name][0] <= position <= ends[name][1]:
                limit = by_name[name]
                shown, lower, upper = beyond_range(position, limit.lower, limit.upper)
                return f"{name} would go to {shown} at point #{index}, outside its limits {lower} to {upper}"
        rates = ("move", point.velocities, "velocity"), ("accelerate", point.accelerations, "acceleration")
        for verb, values, kind in rates:
            for name, value in zip(goal.joints, values, strict=False):
                if abs(value) > (bound := getattr(by_name[name], kind)) * (1.0 + ROUNDING):
                    shown, most = apart(value, math.copysign(bound, value))
                    return f"{name} would {verb} at {shown} at point #{index}, beyond its limit {most.lstrip('-')}"
    return None


def _ends(limit: JointLimits, stands: Sequence[float]) -> tuple[float, float]:
    """Return the lowest and the highest position that a point may specify."""
    slack = AT_LIMIT * (limit.upper - limit.lower)
    lower, upper = min(stands, default=math.inf), max(stands, default=-math.inf)
    return (
        min(limit.lower, lower) - (slack if lower <= limit.lower + slack else ROUNDING * abs(limit.lower)),
        max(limit.upper, upper) + (slack if upper >= limit.upper - slack else ROUNDING * abs(limit.upper)),
    )


def _joints_reason(goal: TrajectoryGoal, joints: Sequence[str], partial: bool) -> str | None:
    if not partial and len(goal.joints) != len(joints):
        return (
            "Joints on incoming trajectory don't match the controller joints. The goal names "
            f"{_listed(goal.joints)}, but the controller has {_listed(joints)}: name each joint of the controller."
        )
    if not goal.joints:
        return "Empty joint names on incoming trajectory."
    for name in goal.joints:
        if name not in joints:
            shown = f"The controller has {_listed(joints)}: correct the name"
            return f"Incoming joint {name[:LONGEST_NAME]} doesn't match the controller's joints. {shown}."
        if goal.joints.count(name) > 1:  # ros2_control uses the last entry, and moves the joint that is missing to 0.
            return f"Joint {name} is named twice: name each joint once."
    return None


def _listed(joints: Sequence[str]) -> str:
    """Return the number of joints and the first names. A goal may name thousands of joints."""
    names = [name[:LONGEST_NAME] for name in joints[:MOST_NAMES]] + ["…"] * (len(joints) > MOST_NAMES)
    return f"{len(joints)} ({', '.join(names)})" if names else "no joints"


def _points_reason(goal: TrajectoryGoal, integration: bool) -> str | None:
    if len(goal.points) > LARGEST_GOAL:
        return f"the goal has {len(goal.points)} points: send at most {LARGEST_GOAL} points in one goal"
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
    for kind in ("positions", "velocities", "accelerations"):
        size = len(getattr(point, kind))
        needed = kind == "positions" and not (integration and derivatives)
        if size != len(goal.joints) and (size or needed):
            return f"Mismatch between joint_names size ({len(goal.joints)}) and {kind} ({size}) at point #{index}."
    return None


def _times_reason(goal: TrajectoryGoal) -> str | None:
    times = [point.time_from_start_s for point in goal.points]
    if not all(map(math.isfinite, times)):
        return f"times must be finite, not {', '.join(map(str, times))} s"
    for index, (before_s, time_s) in enumerate(pairwise(times)):
        if time_s <= before_s:
            return (
                f"Time between points {index} and {index + 1} is not strictly increasing, it is "
                f"{before_s:f} and {time_s:f} respectively"
            )
    end_s = times[-1] + goal.delay_s
    if goal.delay_s < 0.0 and end_s < 0.0:
        return f"Received trajectory with non-zero start time that ends in the past ({-end_s:.3f} s ago)"
    if max(times[-1], end_s) > LONGEST_GOAL_S:
        return (
            f"the trajectory would end {end_s:.0f} s from now, but the maximum is {LONGEST_GOAL_S:.0f} s: check that "
            "its point times start at 0 and that its stamp uses the stack's clock (or /clock in simulated time)"
        )
    return None


def _not_finite(goal: TrajectoryGoal) -> str | None:
    for index, point in enumerate(goal.points):
        for values in (point.positions, point.velocities, point.accelerations):
            for name, value in zip(goal.joints, values, strict=False):
                if not math.isfinite(value):
                    return f"{name} must be finite at point #{index}, not {value}"
    return None


def _end_reason(goal: TrajectoryGoal) -> str | None:
    for name, velocity in zip(goal.joints, goal.points[-1].velocities, strict=False):
        if abs(velocity) > STANDS_STILL:
            return f"Velocity of last trajectory point of joint {name} is not zero: {velocity:.15f}"
    return None
