"""Plans of a motion planner as the browser view shows them. Other programs may publish plans that cannot be shown."""

import math

import pytest

pytest.importorskip("moveit_msgs")

from builtin_interfaces.msg import Duration
from moveit_msgs.msg import DisplayTrajectory, RobotTrajectory
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from nodes.planning_client.scene_watch import plan_of


def message(*rows: list[float]) -> DisplayTrajectory:
    """Return a plan for two joints, with one point per second."""
    points = [
        JointTrajectoryPoint(positions=row, time_from_start=Duration(sec=number)) for number, row in enumerate(rows)
    ]
    own = JointTrajectory(joint_names=["joint1", "joint2"], points=points)
    return DisplayTrajectory(trajectory=[RobotTrajectory(joint_trajectory=own), RobotTrajectory()])


def test_the_last_part_with_points_is_shown() -> None:
    shown = plan_of(message([1.0, 2.0], [3.0, 4.0]))
    assert shown is not None
    assert shown.joints == ("joint1", "joint2")
    assert shown.times_s.tolist() == [0.0, 1.0]
    assert shown.positions.tolist() == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize("rows", [[], [[1.0, 2.0], [3.0]], [[1.0], [3.0]], [[1.0, 2.0], [3.0, math.inf]]])
def test_a_plan_without_a_finite_position_of_each_joint_is_not_shown(rows: list[list[float]]) -> None:
    assert plan_of(message(*rows)) is None
