"""The tool follows straight lines, and a path that ends early reports how far it got and why it ended."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.rotations import angle_between, slerp
from hal.types import FloatArray
from planning.kinematics.cartesian import Checks, Steps, ToolPath, tool_path
from planning.kinematics.chain import ToolPose
from planning.kinematics.goals import GoalError
from tests.planning.chains import chain

READY = np.array([0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828])
"""Positions of the robot_arm in which the gripper points forward and down."""
DOWN = np.array([0.0, -0.2, -0.9, -1.1, 2.2 - math.pi, 0.3])
"""Positions of the robot_arm in which the gripper points straight down."""


def moved(start: FloatArray, offset_m: Sequence[float], arm: str = "robot_arm") -> ToolPose:
    """Return the pose of the tool, moved along the axes of the base."""
    pose = chain(arm).pose(start)
    return ToolPose(pose.position_m + offset_m, pose.quaternion_xyzw)


def path(start: FloatArray, *poses: ToolPose, steps: Steps | None = None, checks: Checks | None = None) -> ToolPath:
    return tool_path(chain("robot_arm"), start, poses, steps or Steps(), checks)


@settings(max_examples=15)
@given(st.tuples(st.floats(-0.04, 0.04), st.floats(-0.04, 0.04), st.floats(-0.04, 0.04)), st.floats(-1.0, 1.0))
def test_the_tool_stays_on_the_line_and_turns_at_a_constant_rate(offset: tuple[float, ...], turn_rad: float) -> None:
    turned = DOWN + np.array([0.0, 0.0, 0.0, 0.0, 0.0, turn_rad])
    start, end = chain("robot_arm").pose(DOWN), moved(turned, offset)
    found = path(DOWN, end)
    assert (found.fraction, found.reason) == (1.0, "")
    poses = [chain("robot_arm").pose(at) for at in found.positions]
    for number, pose in enumerate(poses):
        share = number / (len(poses) - 1)
        line = start.position_m + share * (end.position_m - start.position_m)
        assert np.linalg.norm(pose.position_m - line) < 1e-3
        assert angle_between(pose.quaternion_xyzw, slerp(start.quaternion_xyzw, end.quaternion_xyzw, share)) < 0.02
    steps_m = np.linalg.norm(np.diff([pose.position_m for pose in poses], axis=0), axis=1)
    assert steps_m.max() < 0.01 + 1e-3
    assert np.abs(np.diff(found.positions, axis=0)).max() <= 0.5


def test_waypoints_are_passed_in_turn() -> None:
    corner, end = moved(DOWN, (0.0, 0.0, 0.03)), moved(DOWN, (0.03, 0.0, 0.03))
    found = path(DOWN, corner, end)
    assert found.fraction == 1.0
    assert len(found.positions) == 7
    assert chain("robot_arm").pose(found.positions[3]).position_m == pytest.approx(corner.position_m, abs=1e-3)
    assert found.positions[0] == pytest.approx(DOWN)


def test_a_path_ends_at_the_edge_of_the_reach() -> None:
    found = path(READY, moved(READY, (0.0, 0.0, 0.05)), moved(READY, (2.0, 0.0, 0.05)))
    assert 0.5 < found.fraction < 0.7
    assert "the arm cannot follow the line: gripper_base_link stays" in found.reason or "limit" in found.reason
    last = chain("robot_arm").pose(found.positions[-1]).position_m
    goal = moved(READY, (2.0 * (2.0 * found.fraction - 1.0), 0.0, 0.05)).position_m
    assert last == pytest.approx(goal, abs=1e-3)


def test_the_joint_at_its_limit_is_named() -> None:
    """Only joint6 turns a gripper that points down. The upper limit of joint6 is 3.05 rad."""
    over = DOWN + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.7])
    wide = DOWN + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.5])
    twice = DOWN + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    assert path(DOWN, moved(wide, (0, 0, 0)), moved(over, (0, 0, 0))).fraction == 1.0
    found = path(DOWN, moved(wide, (0, 0, 0)), moved(twice, (0, 0, 0)))
    assert found.reason == "joint6 reaches its upper limit 3.0500"
    assert found.fraction == pytest.approx(0.5 + 0.5 * 1.25 / 1.5, abs=0.03)


def test_jumps_of_the_joints_end_the_path() -> None:
    end = moved(DOWN, (0.0, 0.0, 0.04))
    assert path(DOWN, end, steps=Steps(jump_rad=0.3)).fraction == 1.0
    found = path(DOWN, end, steps=Steps(jump_rad=0.01))
    assert (found.fraction, len(found.positions)) == (0.0, 1)
    assert "in one step of the tool, above 0.01 rad" in found.reason
    assert path(DOWN, end, steps=Steps(jump_factor=3.0)).fraction == 1.0
    near, turn = (
        moved(DOWN, (0.0, 0.0, 0.005)),
        moved(DOWN + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.7]), (0.0, 0.0, 0.005)),
    )
    few = path(DOWN, near, turn, steps=Steps(longest_m=0.2, jump_factor=1.2, jump_rad=0.0))
    assert few.fraction == 0.5
    assert "times the mean step, but the jump threshold is 1.2" in few.reason


def test_the_path_ends_before_a_collision_with_its_text() -> None:
    end, start = moved(DOWN, (0.0, 0.0, 0.04)), moved(DOWN, (0.0, 0.0, 0.0)).position_m

    def touches(at: FloatArray) -> str:
        return "link5 touches box" if chain("robot_arm").pose(at).position_m[2] > start[2] + 0.025 else ""

    at = path(DOWN, end, checks=Checks(at=touches))
    between = path(DOWN, end, checks=Checks(between=lambda _, after: touches(after)))
    for found in (at, between):
        assert (found.fraction, len(found.positions), found.reason) == (0.5, 3, "link5 touches box")
    begun = path(DOWN, end, checks=Checks(at=lambda _: "hand touches cube"))
    assert (begun.fraction, len(begun.positions), begun.reason) == (0.0, 1, "hand touches cube")


@pytest.mark.parametrize(
    ("steps", "poses", "message"),
    [
        ({"longest_m": 0.0}, 1, "the maximum step is 0 m: send a finite number above 0"),
        ({"longest_m": math.nan}, 1, "the maximum step is nan m"),
        ({"jump_factor": -1.0}, 1, "jump_factor is -1: send 0 for no limit, or a number above 0"),
        ({"longest_m": 1e-6}, 1, "steps, above 20000: send a larger maximum step"),
        ({"longest_m": 5e-324}, 1, "the path has inf steps, above 20000"),
        ({}, 0, "the path has no waypoints: send at least one pose"),
    ],
)
def test_wrong_requests_are_refused(steps: dict[str, float], poses: int, message: str) -> None:
    with pytest.raises(GoalError, match=message) as caught:
        path(DOWN, *[moved(DOWN, (0.0, 0.0, 0.04))] * poses, steps=Steps(**steps))
    assert caught.value.code == "INVALID_GOAL_CONSTRAINTS"


def test_a_wrong_waypoint_is_refused() -> None:
    with pytest.raises(GoalError, match="length 0"):
        path(DOWN, ToolPose(np.zeros(3), np.zeros(4)))


@pytest.mark.parametrize("distance_m", [2e3, 1e300])
def test_a_tool_that_is_too_far_away_is_refused(distance_m: float) -> None:
    """The tool may be an attached object, whose pose a client chooses."""
    held = chain("robot_arm").at_frame(np.eye(3), np.array([0.0, 0.0, distance_m]))
    with pytest.raises(GoalError, match=r"1000 m away from the base: .* gripper_base_link") as caught:
        tool_path(held, DOWN, [moved(DOWN, (0.0, 0.0, 0.04))], Steps())
    assert caught.value.code == "INVALID_GOAL_CONSTRAINTS"


def test_a_five_joint_arm_keeps_the_line_and_turns_within_the_tolerance() -> None:
    """The SO-101 cannot keep the yaw of its tool on a sideways line."""
    start = np.array([0.3, -0.3, 0.4, 0.8, 0.0])
    end = moved(start, (0.0, 0.05, 0.0), "so101")
    assert tool_path(chain("so101"), start, [end], Steps()).fraction < 1.0
    found = tool_path(chain("so101"), start, [end], Steps(deviation_rad=(0.5, 0.5, 0.5)))
    assert found.fraction == 1.0
    assert chain("so101").pose(found.positions[-1]).position_m == pytest.approx(end.position_m, abs=1e-3)
