"""Integrate positions for goals that contain only velocities or accelerations."""

from collections.abc import Sequence
from dataclasses import replace

from controller.motion import Kinematics
from controller.trajectory.goal import GoalPoint, TrajectoryGoal


def integrated(goal: TrajectoryGoal, joints: Sequence[str], start: Kinematics) -> TrajectoryGoal:
    """Return a copy of a goal in which missing positions and velocities are computed by integration."""
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
