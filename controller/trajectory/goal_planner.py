"""Plan a goal in the thread that accepts it, before the arm moves.

A plan starts from the current joint positions. If the joints have moved when the goal starts, the loop thread replans
the motion to the first point and then joins the rest of the plan.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, Literal

import numpy as np

from controller.motion import Kinematics, MotionError, Path, motion_to, plan_stop
from controller.trajectory.goal import Allowed, GoalPoint, TrajectoryGoal, limits_reason, reason_to_reject
from controller.trajectory.integration import integrated
from controller.trajectory.paths import (
    Joined,
    PathTask,
    begun_at,
    jerk_limited_path,
    smooth_lead,
    spline_lead,
    spline_path,
)
from controller.trajectory.steps import StepPlan
from controller.trajectory.waypoints import Waypoints
from hal.types import FloatArray, JointLimits

Method = Literal["splines", "none", "ruckig"]

JOINS_S: Final = 0.1
"""Time (s) that moving, jerk-limited joints need to join a different path. A point further ahead than twice this time
counts as far away."""


class GoalRejected(Exception):
    """A goal is rejected. The error message is sent to the client."""


@dataclass(frozen=True, slots=True)
class GoalPlanner:
    """Planner that checks and plans goals for one controller. ``endless`` contains the indices of continuous joints."""

    joints: tuple[str, ...]
    limits: tuple[JointLimits, ...]
    method: Method
    endless: tuple[int, ...] = ()

    def plan(
        self, goal: TrajectoryGoal, allowed: Allowed, reference: Kinematics, measured: FloatArray | None = None
    ) -> "Plan":
        """Plan a goal that starts near ``reference`` and the ``measured`` positions (n,). Raises GoalRejected."""
        if reason := reason_to_reject(goal, self.joints, allowed):
            raise GoalRejected(reason)
        if allowed.integration:
            goal = integrated(goal, self.joints, reference)
        stands = [reference.position] if measured is None else [reference.position, measured]
        if reason := limits_reason(goal, self.joints, self.limits, stands):
            raise GoalRejected(reason)
        try:
            waypoints = waypoints_of(goal, self.joints, self.rest(reference))
            if len(goal.points) > 1:
                waypoints = begun_at(waypoints, reference.position)
            waypoints = at_most(ahead(waypoints), self.limits)
            if self.endless:
                waypoints = waypoints.by_shortest_turn(reference.position, self.endless)
            plan = prepare(self.method, PathTask(reference, waypoints, self.limits, self.joints))
            plan.join(reference, 0.0)
        except MotionError as error:
            raise GoalRejected(str(error)) from error
        return plan

    def warm_up(self) -> None:
        """Plan a dummy goal, so that the first real goal does not have to wait for modules to load."""
        here = np.clip(np.zeros(len(self.joints)), *self._ends())
        point = GoalPoint(tuple(here.tolist()), 1.0)
        self.plan(TrajectoryGoal(self.joints, (point,)), Allowed(), Kinematics.at_rest(here))

    def rest(self, reference: Kinematics) -> FloatArray:
        """Return the positions (n,) at which joints that a goal omits rest or can stop. Raises MotionError."""
        return np.clip((stop := plan_stop(reference, self.limits)).sample(stop.duration_s).position, *self._ends())

    def _ends(self) -> tuple[list[float], list[float]]:
        return [limit.lower for limit in self.limits], [limit.upper for limit in self.limits]


def waypoints_of(goal: TrajectoryGoal, joints: Sequence[str], rest: FloatArray) -> Waypoints:
    """Convert the points of a goal to waypoints. Joints that the goal does not include stay at ``rest`` (n,).

    The joints hold the last point, so they must be at rest there, even if the goal specifies a velocity for it.
    """
    columns = [joints.index(name) for name in goal.joints]
    count = len(goal.points)
    position = np.tile(rest, (count, 1))
    velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
    for row, point in enumerate(goal.points):
        position[row, columns] = point.positions
        if point.velocities:
            velocity[row, columns] = point.velocities
            if point.accelerations:
                acceleration[row, columns] = point.accelerations
    velocity[-1], acceleration[-1] = 0.0, 0.0
    times_s = np.array([point.time_from_start_s for point in goal.points]) + goal.starts_s
    has_velocity = np.array([bool(point.velocities) for point in goal.points])
    has_acceleration = has_velocity & np.array([bool(point.accelerations) for point in goal.points])
    return Waypoints(times_s, position, velocity, acceleration, has_velocity, has_acceleration)


def ahead(waypoints: Waypoints) -> Waypoints:
    """Return the waypoints whose time has not passed yet. The last waypoint is always included."""
    first = first_ahead(waypoints.times_s, 0.0)
    return Waypoints(*(getattr(waypoints, field.name)[first:] for field in fields(waypoints)))


def at_most(waypoints: Waypoints, limits: Sequence[JointLimits]) -> Waypoints:
    """Clip the waypoints to the limits. The goal check accepts values slightly beyond the limits."""
    lower, upper, velocity, acceleration = np.array(
        [(limit.lower, limit.upper, limit.velocity, limit.acceleration) for limit in limits]
    ).T
    position = np.clip(waypoints.position, lower, upper)
    inside = position == waypoints.position  # A joint at a limit must be at rest.
    return replace(
        waypoints,
        position=position,
        velocity=np.where(inside, np.clip(waypoints.velocity, -velocity, velocity), 0.0),
        acceleration=np.where(inside, np.clip(waypoints.acceleration, -acceleration, acceleration), 0.0),
    )


def first_ahead(times_s: FloatArray, now_s: float) -> int:
    """Return the index of the first point whose time has not passed yet, or of the last point if there is none."""
    return min(int(np.searchsorted(times_s, now_s, side="right")), len(times_s) - 1)


def joined_at(times_s: FloatArray, now_s: float) -> int:
    """Return the index of the point at which moving joints join a path.

    The result is the first point that leaves the joints enough time. If that point is more than twice ``JOINS_S``
    ahead, the result is the point before it, unless the time of that earlier point has passed. A motion to a point that
    is too close in time ends late, and a stream of short paths would fall further behind with each message.
    """
    index = first_ahead(times_s, now_s + JOINS_S)
    return index if times_s[index] <= now_s + 2.0 * JOINS_S else max(index - 1, first_ahead(times_s, now_s))


def prepare(method: Method, task: PathTask) -> "Plan":
    """Prepare a plan using the given interpolation method. Raises MotionError if no motion is possible within the
    limits."""
    if method == "none":
        return StepPlan(task.waypoints)
    if method == "splines" or len(task.waypoints.times_s) > 1:
        path, passes_s = spline_path(task) if method == "splines" else jerk_limited_path(task)
        return PathPlan(task, path, passes_s, smooth=method != "splines")
    # Most clients send a single point and wait for the result.
    target, asked_s = Kinematics.at_rest(task.waypoints.position[0]), max(float(task.waypoints.times_s[0]), 0.0)
    only = motion_to(task.start, target, task.limits, asked_s, task.names)
    return PathPlan(task, only, np.array([only.duration_s]), smooth=True)


@dataclass(frozen=True, slots=True)
class PathPlan:
    """Plan of a whole path. ``passes_s`` (m,) contains the times at which the path passes each point."""

    task: PathTask
    path: Path
    passes_s: FloatArray
    smooth: bool
    """Whether the motion to the path is planned with ruckig."""

    def join(self, reference: Kinematics, waited_s: float) -> Path:
        """Return the path from the joints' current state, ``waited_s`` after the planned start.

        If nothing has changed, this is the planned path. Otherwise, the returned path starts with a new motion to the
        next point of the planned path. Raises MotionError.
        """
        if not waited_s and self._still_there(reference):
            return self.path
        waypoints = self.task.waypoints
        moving = self.smooth and bool(reference.velocity.any())
        index = (joined_at if moving else first_ahead)(waypoints.times_s, waited_s)
        span_s = max(float(waypoints.times_s[index]) - waited_s, 0.0)
        from_s = float(self.passes_s[index])
        target = self.path.sample(from_s)
        lead = smooth_lead if self.smooth else spline_lead
        first = lead(self.task, reference, target, index, span_s)
        return Joined(first, self.path, from_s, max(float(waypoints.times_s[-1]) - waited_s, 0.0))

    def _still_there(self, reference: Kinematics) -> bool:
        moving = reference.velocity.any() or reference.acceleration.any()
        return not moving and np.allclose(reference.position, self.task.start.position, rtol=0.0, atol=1e-9)


Plan = PathPlan | StepPlan
"""Plan of a goal, prepared before the goal is accepted. The loop thread joins the plan when the goal starts."""
