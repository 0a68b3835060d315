"""A trajectory goal, its handle, and the reasons to reject a goal before anything moves.

The texts are ros2_control's where it has some.
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
"""Points of one goal: the ROS thread prepares them in some tenths of a second."""
LONGEST_GOAL_S: Final = 3_600.0
"""Planners make tables by time, and ruckig plans for two hours at most. What ends later is mostly of another clock."""
ROUNDING: Final = 1e-6
"""The share by which a value may exceed a limit: planners go up to their limits, and round (MoveIt's by 1e-13)."""
STANDS_STILL: Final = 1.19e-7
"""Upstream's limit for a last velocity that counts as zero."""


@dataclass(frozen=True, slots=True)
class GoalPoint:
    """One way-point in the client's joint order; times in seconds from the trajectory's start."""

    positions: tuple[float, ...]
    time_from_start_s: float
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()
    has_effort: bool = False


@dataclass(frozen=True, slots=True)
class TrajectoryGoal:
    """A goal as the client sent it. ``delay_s`` is its stamp relative to now; 0 means now."""

    joints: tuple[str, ...]
    points: tuple[GoalPoint, ...]
    tolerances: Tolerances = field(default_factory=Tolerances)
    delay_s: float = 0.0
    from_topic: bool = False
    """No client waits for the goal's end."""
    next_cycle_s: float = 0.0
    """Seconds from now to the cycle in which the goal can begin."""
    begins_s: float | None = None
    """The time of that cycle by the loop's clock; None: the goal is never late."""

    @property
    def starts_s(self) -> float:
        """The start of the points' times, seen from that cycle: a stamp is a point in time, 0 is that cycle."""
        return self.delay_s - self.next_cycle_s if self.delay_s else 0.0


class GoalHandle:
    """An accepted goal. The loop's thread decides it; any thread may look."""

    def __init__(self, goal: TrajectoryGoal) -> None:
        self.goal = goal
        self.status = GoalStatus.EXECUTING
        self.error_code = ErrorCode.SUCCESSFUL
        self.error_text = ""

    @property
    def done(self) -> bool:
        """Whether the goal is decided."""
        return self.status is not GoalStatus.EXECUTING

    def decide(self, status: GoalStatus, error_code: int, text: str) -> None:
        """The first decision stands; status comes last, because other threads look at it."""
        if not self.done:
            self.error_code, self.error_text = error_code, text
            self.status = status


@dataclass(frozen=True, slots=True)
class Allowed:
    """Goals beyond the ordinary that a controller's parameters allow."""

    partial: bool = False
    integration: bool = False
    moving_end: bool = False


def reason_to_reject(goal: TrajectoryGoal, joints: Sequence[str], allowed: Allowed) -> str | None:
    """The reason why this goal makes no sense whatever the limits, or None."""
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
    """The reason why a point is itself beyond a limit: the first such point, or None.

    ``stands``: positions (n,) where the joints stand, as measured and as commanded. One that stands at a limit or
    beyond may be sent from there: the plan takes such points to the limit.
    """
    by_name = dict(zip(joints, limits, strict=True))
    ends = {name: _ends(by_name[name], [float(at[i]) for at in stands]) for i, name in enumerate(joints)}
    for index, point in enumerate(goal.points):
        for name, position in zip(goal.joints, point.positions, strict=False):
            if not ends[name][0] <= position <= ends[name][1]:
                limit = by_name[name]
                said, lower, upper = beyond_range(position, limit.lower, limit.upper)
                return f"{name} would go to {said} at point #{index}, outside its limits {lower} to {upper}"
        rates = ("move", point.velocities, "velocity"), ("accelerate", point.accelerations, "acceleration")
        for verb, values, kind in rates:
            for name, value in zip(goal.joints, values, strict=False):
                if abs(value) > (bound := getattr(by_name[name], kind)) * (1.0 + ROUNDING):
                    said, most = apart(value, math.copysign(bound, value))
                    return f"{name} would {verb} at {said} at point #{index}, beyond its limit {most.lstrip('-')}"
    return None


def _ends(limit: JointLimits, stands: Sequence[float]) -> tuple[float, float]:
    """The positions between which a point may lie."""
    slack = AT_LIMIT * (limit.upper - limit.lower)
    lower, upper = min(stands, default=math.inf), max(stands, default=-math.inf)
    return (
        min(limit.lower, lower) - (slack if lower <= limit.lower + slack else ROUNDING * abs(limit.lower)),
        max(limit.upper, upper) + (slack if upper >= limit.upper - slack else ROUNDING * abs(limit.upper)),
    )


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
    if not all(map(math.isfinite, times)):
        return f"times are {', '.join(map(str, times))} s: only finite numbers are executed"
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
            f"the trajectory would end {end_s:.0f} s from now, and the most is {LONGEST_GOAL_S:.0f} s: the points' "
            "times count from its start, and its stamp by the stack's clock (simulated time where /clock has it)"
        )
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
