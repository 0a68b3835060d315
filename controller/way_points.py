"""A goal in the controller's joint order, as arrays: the course that a path is planned along."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from controller.goal import GoalPoint, TrajectoryGoal
from controller.motion import Kinematics
from hal.types import FloatArray

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Course:
    """m points of n joints: ``times_s`` (m,) from now, the others (m, n) in rad or m and seconds.

    ``has_velocity`` and ``has_acceleration`` (m,) say where the goal gives them; elsewhere they are 0.
    Accelerations count only beside velocities (upstream stands still on those without, and then leaps).
    """

    times_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    has_velocity: BoolArray
    has_acceleration: BoolArray

    def after(self, start: int) -> "Course":
        """Without its first ``start`` points."""
        return Course(*(getattr(self, name)[start:] for name in self.__dataclass_fields__))


def course_of(goal: TrajectoryGoal, joints: Sequence[str], rest: FloatArray) -> Course:
    """What of the goal lies ahead. A joint that it does not name stays at ``rest`` (n,).

    Points whose time has passed are left out, but never the last one. The last one is held, so it is
    reached at rest whatever velocity the goal gives it.
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
    course = Course(times_s, position, velocity, acceleration, has_velocity, has_acceleration)
    return course.after(first_ahead(times_s, 0.0))


def first_ahead(times_s: FloatArray, now_s: float) -> int:
    """The first point whose time has not come yet, or else the last one."""
    return min(int(np.searchsorted(times_s, now_s, side="right")), len(times_s) - 1)


def unwound(course: Course, start: FloatArray, continuous: Sequence[int]) -> Course:
    """Joints without ends (their indices) set out on the shorter way round; ``start`` (n,)."""
    columns = list(continuous)
    if not columns:
        return course
    turns = np.round((start[columns] - course.position[0, columns]) / math.tau)
    position = course.position.copy()
    position[:, columns] += turns * math.tau
    return replace(course, position=position)


def integrated(goal: TrajectoryGoal, joints: Sequence[str], start: Kinematics) -> TrajectoryGoal:
    """Positions where the goal has only velocities, velocities where it has only accelerations."""
    columns = [joints.index(name) for name in goal.joints]
    before = GoalPoint(tuple(start.position[columns]), -goal.starts_s, tuple(start.velocity[columns]))
    points: list[GoalPoint] = []
    for point in goal.points:
        before = _integrated(before, point) if not point.positions else point
        points.append(before)
    return replace(goal, points=tuple(points))


def _integrated(before: GoalPoint, point: GoalPoint) -> GoalPoint:
    span_s = max(point.time_from_start_s - before.time_from_start_s, 0.0)
    still = (0.0,) * len(before.positions)
    old_a, old_v = before.accelerations or still, before.velocities or still
    speeds = zip(old_v, old_a, point.accelerations or still, strict=True)
    velocities = point.velocities or tuple(v + (a + b) * span_s / 2.0 for v, a, b in speeds)
    ways = zip(before.positions, old_v, velocities, strict=True)
    return replace(point, positions=tuple(p + (v + w) * span_s / 2.0 for p, v, w in ways), velocities=velocities)
