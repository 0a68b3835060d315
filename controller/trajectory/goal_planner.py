"""The goal planner turns a goal into a plan before anything moves, in the thread that takes goals.

A plan is prepared from where the joints are then. The loop's thread only joins it: it plans the way to the first point
anew where the joints have moved since.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, Literal

import numpy as np

from controller.motion import Kinematics, MotionError, Path, motion_to, plan_stop
from controller.trajectory.goal import Allowed, GoalPoint, TrajectoryGoal, limits_reason, reason_to_reject
from controller.trajectory.integration import integrated
from controller.trajectory.paths import Joined, Task, begun_at, jerk_limited_path, smooth_lead, spline_lead, spline_path
from controller.trajectory.steps import StepPlan
from controller.trajectory.waypoints import Waypoints
from hal.types import FloatArray, JointLimits

Method = Literal["splines", "none", "ruckig"]

JOINS_S: Final = 0.1
"""Time in which jerk-limited joints that move reach another path; a point after twice the time is not close."""


class GoalRejected(Exception):
    """A goal is not accepted; the text is for the client."""


@dataclass(frozen=True, slots=True)
class GoalPlanner:
    """The planner checks and plans the goals of one controller; ``endless`` are the indices of joints without ends."""

    joints: tuple[str, ...]
    limits: tuple[JointLimits, ...]
    method: Method
    endless: tuple[int, ...] = ()

    def plan(
        self, goal: TrajectoryGoal, allowed: Allowed, reference: Kinematics, measured: FloatArray | None = None
    ) -> "Plan":
        """The goal's plan from about ``reference``; ``measured`` (n,) is where the joints are. Raises GoalRejected."""
        if reason := reason_to_reject(goal, self.joints, allowed):
            raise GoalRejected(reason)
        if allowed.integration:
            goal = integrated(goal, self.joints, reference)
        stands = [reference.position] if measured is None else [reference.position, measured]
        if reason := limits_reason(goal, self.joints, self.limits, stands):
            raise GoalRejected(reason)
        try:
            waypoints = waypoints_of(goal, self.joints, self._rest(goal.joints, reference))
            if len(goal.points) > 1:
                waypoints = begun_at(waypoints, reference.position)
            waypoints = at_most(ahead(waypoints), self.limits)
            if self.endless:
                waypoints = waypoints.by_shortest_turn(reference.position, self.endless)
            plan = prepare(self.method, Task(reference, waypoints, self.limits, self.joints))
            plan.join(reference, 0.0)
        except MotionError as error:
            raise GoalRejected(str(error)) from error
        return plan

    def warm_up(self) -> None:
        """Plan once for nothing: the first goal must not wait until all that planning needs has been loaded."""
        here = np.clip(np.zeros(len(self.joints)), *self._ends())
        point = GoalPoint(tuple(here.tolist()), 1.0)
        self.plan(TrajectoryGoal(self.joints, (point,)), Allowed(), Kinematics.at_rest(here))

    def _rest(self, named: Sequence[str], reference: Kinematics) -> FloatArray:
        """The positions of joints that the goal does not name: here, or where they can come to rest."""
        if len(named) == len(self.joints) or not reference.velocity.any():
            return reference.position
        rest = plan_stop(reference, self.limits)
        return np.clip(rest.sample(rest.duration_s).position, *self._ends())

    def _ends(self) -> tuple[list[float], list[float]]:
        return [limit.lower for limit in self.limits], [limit.upper for limit in self.limits]


def waypoints_of(goal: TrajectoryGoal, joints: Sequence[str], rest: FloatArray) -> Waypoints:
    """The goal's points. A joint that the goal does not name stays at ``rest`` (n,).

    The last point is held, so it is reached at rest whatever velocity the goal gives it.
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
    """The points whose time has not passed; always the last one."""
    first = first_ahead(waypoints.times_s, 0.0)
    return Waypoints(*(getattr(waypoints, field.name)[first:] for field in fields(waypoints)))


def at_most(waypoints: Waypoints, limits: Sequence[JointLimits]) -> Waypoints:
    """The same points, what is beyond a limit by as little as was allowed taken to it."""
    lower, upper, velocity, acceleration = np.array(
        [(limit.lower, limit.upper, limit.velocity, limit.acceleration) for limit in limits]
    ).T
    position = np.clip(waypoints.position, lower, upper)
    inside = position == waypoints.position  # at a limit a joint stands
    return replace(
        waypoints,
        position=position,
        velocity=np.where(inside, np.clip(waypoints.velocity, -velocity, velocity), 0.0),
        acceleration=np.where(inside, np.clip(waypoints.acceleration, -acceleration, acceleration), 0.0),
    )


def first_ahead(times_s: FloatArray, now_s: float) -> int:
    """The first point whose time has not come yet, or else the last one."""
    return min(int(np.searchsorted(times_s, now_s, side="right")), len(times_s) - 1)


def joined_at(times_s: FloatArray, now_s: float) -> int:
    """The point at which joints in motion join a path: the first point that leaves them time, or else one before it.

    The way to a point that is too near ends late, and a stream of short paths would lag further with each message.
    """
    index = first_ahead(times_s, now_s + JOINS_S)
    return index if times_s[index] <= now_s + 2.0 * JOINS_S else max(index - 1, first_ahead(times_s, now_s))


def prepare(method: Method, task: Task) -> "Plan":
    """Prepare a plan by the given method. Raises MotionError where there is no way within the limits."""
    if method == "none":
        return StepPlan(task.waypoints)
    if method == "splines" or len(task.waypoints.times_s) > 1:
        path, passes_s = spline_path(task) if method == "splines" else jerk_limited_path(task)
        return PathPlan(task, path, passes_s, smooth=method != "splines")
    # One point: what most clients send, and wait for.
    target, asked_s = Kinematics.at_rest(task.waypoints.position[0]), max(float(task.waypoints.times_s[0]), 0.0)
    only = motion_to(task.start, target, task.limits, asked_s, task.names)
    return PathPlan(task, only, np.array([only.duration_s]), smooth=True)


@dataclass(frozen=True, slots=True)
class PathPlan:
    """The plan of a whole path, and when (m,) the path passes each point."""

    task: Task
    path: Path
    passes_s: FloatArray
    smooth: bool
    """Whether the way to it is by ruckig."""

    def join(self, reference: Kinematics, waited_s: float) -> Path:
        """The path from where the joints are now; the points' times have come ``waited_s`` nearer. Raises MotionError.

        The path itself where nothing has changed, or else a way to its first point that lies ahead.
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
"""A goal's way, ready when the goal is accepted; the loop's thread joins it."""
