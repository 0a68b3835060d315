"""From a goal's points to way-points with a velocity each, in the controller's joint order."""

from collections.abc import Sequence

import numpy as np

from controller.goal import TrajectoryGoal, in_order
from controller.motion import Kinematics, WayPoint
from hal.types import FloatArray, JointLimits


def way_points(goal: TrajectoryGoal, joints: Sequence[str], limits: Sequence[JointLimits]) -> list[WayPoint]:
    """What lies ahead; points whose time has passed are dropped, but never the last one."""
    bound = np.array([limit.velocity for limit in limits])
    points: list[WayPoint] = []
    for index, point in enumerate(goal.points):
        time_s = point.time_from_start_s + goal.delay_s
        if time_s <= 0.0 and index < len(goal.points) - 1:
            continue
        acceleration = point.accelerations or (0.0,) * len(joints)
        state = Kinematics(
            in_order(goal, joints, point.positions),
            np.clip(_velocity(goal, joints, index), -bound, bound),
            in_order(goal, joints, acceleration),
        )
        points.append(WayPoint(state, time_s))
    # The last position is held, so the motion ends at rest whatever velocity the goal gives it.
    points[-1] = WayPoint(Kinematics.at_rest(points[-1].state.position), points[-1].time_s)
    return points


def _velocity(goal: TrajectoryGoal, joints: Sequence[str], index: int) -> FloatArray:
    """As given; else the smaller slope beside the point, and zero where a joint turns round."""
    point = goal.points[index]
    if point.velocities:
        return in_order(goal, joints, point.velocities)
    if index in (0, len(goal.points) - 1):
        return np.zeros(len(joints))
    before, after = _slope(goal, joints, index - 1), _slope(goal, joints, index)
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0.0, smaller, 0.0)


def _slope(goal: TrajectoryGoal, joints: Sequence[str], index: int) -> FloatArray:
    a, b = goal.points[index], goal.points[index + 1]
    way = in_order(goal, joints, b.positions) - in_order(goal, joints, a.positions)
    return way / (b.time_from_start_s - a.time_from_start_s)
