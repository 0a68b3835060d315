"""A trajectory goal: what a client asked for, what became of it, and why it may be refused."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from hal.types import FloatArray, JointLimits


class GoalStatus(Enum):
    """Life of an accepted goal."""

    EXECUTING = "executing"
    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"


class ErrorCode:
    """error_code of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


@dataclass(frozen=True, slots=True)
class GoalPoint:
    """One way-point in the client's joint order; times in seconds from the trajectory's start."""

    positions: tuple[float, ...]
    time_from_start_s: float
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()
    has_effort: bool = False


LARGEST_GOAL = 500
"""Points of one goal. Planning them takes the loop's thread some 20 ms; more would cost a cycle."""

ERASE = -1.0
"""A tolerance that a goal switches off (control_msgs/JointTolerance)."""


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Largest deviations by joint name (rad, m); a joint that is not named has none.

    In a goal 0 stands for the controller's default and ERASE for none at all.
    """

    path: Mapping[str, float] = field(default_factory=dict)
    goal: Mapping[str, float] = field(default_factory=dict)
    goal_time_s: float = 0.0
    """How long after the end the goal tolerance may stay violated; 0: for ever."""


def resolve(asked: Tolerances, default: Tolerances, joints: Sequence[str]) -> Tolerances:
    """What a goal asks for over the defaults. Raises ValueError, saying why, where it makes no sense."""
    for name in (*asked.path, *asked.goal):
        if name not in joints:
            raise ValueError(f"joint '{name}' does not exist")
    return Tolerances(
        {name: _resolved(asked.path.get(name, 0.0), default.path.get(name, 0.0)) for name in joints},
        {name: _resolved(asked.goal.get(name, 0.0), default.goal.get(name, 0.0)) for name in joints},
        _resolved(asked.goal_time_s, default.goal_time_s),
    )


def _resolved(asked: float, default: float) -> float:
    if asked == ERASE:
        return 0.0
    if not asked >= 0.0:
        raise ValueError(f"{asked} is no tolerance")
    return asked or default


@dataclass(frozen=True, slots=True)
class TrajectoryGoal:
    """What the client sent. ``delay_s`` is its stamp relative to now; 0 means now."""

    joints: tuple[str, ...]
    points: tuple[GoalPoint, ...]
    tolerances: Tolerances = Tolerances()
    delay_s: float = 0.0


class GoalHandle:
    """An accepted goal. The loop's thread decides it; any thread may look."""

    def __init__(self, goal: TrajectoryGoal) -> None:
        self.goal = goal
        self.status = GoalStatus.EXECUTING
        self.error_code = ErrorCode.SUCCESSFUL
        self.error_text = ""

    @property
    def done(self) -> bool:
        """Whether it is decided."""
        return self.status is not GoalStatus.EXECUTING

    def decide(self, status: GoalStatus, error_code: int, text: str) -> None:
        """The first decision stands; status comes last, because other threads look at it."""
        if not self.done:
            self.error_code, self.error_text = error_code, text
            self.status = status


def reason_to_reject(
    goal: TrajectoryGoal, joints: Sequence[str], limits: Sequence[JointLimits], may_end_moving: bool
) -> str | None:
    """Why this goal cannot be accepted, or None. The first seven texts are ros2_control's own."""
    return (
        _joints_reason(goal, joints)
        or _points_reason(goal)
        or _values_reason(goal, joints, limits)
        or (None if may_end_moving else _end_reason(goal))
    )


def in_order(goal: TrajectoryGoal, joints: Sequence[str], values: Sequence[float]) -> FloatArray:
    """Values in the goal's joint order, brought into the controller's; shape (n,)."""
    by_name = dict(zip(goal.joints, values, strict=True))
    return np.array([by_name[name] for name in joints])


def _joints_reason(goal: TrajectoryGoal, joints: Sequence[str]) -> str | None:
    if not goal.points:
        return "Empty trajectory received."
    if len(goal.joints) != len(joints):
        return "Joints on incoming trajectory don't match the controller joints."
    for name in goal.joints:
        if name not in joints:
            return f"Incoming joint {name} doesn't match the controller's joints."
    if len(set(goal.joints)) != len(goal.joints):
        return "A joint is named twice."
    return None


def _points_reason(goal: TrajectoryGoal) -> str | None:
    before_s: float | None = None
    if len(goal.points) > LARGEST_GOAL:
        return f"{len(goal.points)} points are too many: send at most {LARGEST_GOAL} in one goal"
    for index, point in enumerate(goal.points):
        if point.has_effort:
            return (
                "Trajectories with effort fields are only supported for controllers using the 'effort' "
                "command interface."
            )
        for what in ("positions", "velocities", "accelerations"):
            size = len(getattr(point, what))
            if size != len(goal.joints) and (size or what == "positions"):
                return f"Mismatch between joint_names size ({len(goal.joints)}) and {what} ({size}) at point #{index}."
        if before_s is not None and point.time_from_start_s <= before_s:
            return (
                f"Time between points {index - 1} and {index} is not strictly increasing, it is "
                f"{before_s:f} and {point.time_from_start_s:f} respectively"
            )
        before_s = point.time_from_start_s
    end_s = goal.points[-1].time_from_start_s + goal.delay_s
    if goal.delay_s < 0.0 and end_s < 0.0:
        return f"Received trajectory with non-zero start time that ends in the past ({-end_s:.3f} s ago)"
    return None


def _values_reason(goal: TrajectoryGoal, joints: Sequence[str], limits: Sequence[JointLimits]) -> str | None:
    by_name = dict(zip(joints, limits, strict=True))
    for index, point in enumerate(goal.points):
        for values in (point.positions, point.velocities, point.accelerations):
            for name, value in zip(goal.joints, values, strict=False):
                if not np.isfinite(value):
                    return f"{name} is {value} at point #{index}: only finite numbers are executed"
        for name, position in zip(goal.joints, point.positions, strict=True):
            limit = by_name[name]
            if not limit.lower <= position <= limit.upper:
                return (
                    f"{name} would go to {position:.4f} at point #{index}, outside its limits "
                    f"{limit.lower:.4f} to {limit.upper:.4f}"
                )
        for name, velocity in zip(goal.joints, point.velocities, strict=False):
            if abs(velocity) > by_name[name].velocity:
                return (
                    f"{name} would move at {velocity:.4f} at point #{index}, beyond its limit "
                    f"{by_name[name].velocity:.4f}"
                )
        for name, acceleration in zip(goal.joints, point.accelerations, strict=False):
            if abs(acceleration) > by_name[name].acceleration:
                return (
                    f"{name} would accelerate at {acceleration:.4f} at point #{index}, beyond its limit "
                    f"{by_name[name].acceleration:.4f}"
                )
    return None


def _end_reason(goal: TrajectoryGoal) -> str | None:
    for name, velocity in zip(goal.joints, goal.points[-1].velocities, strict=False):
        if abs(velocity) > 1.19e-7:
            return f"Velocity of last trajectory point of joint {name} is not zero: {velocity:.15f}"
    return None
