"""Goals of clients are checked, and regions contain all poses that their tolerances allow."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.rotations import matrices
from hal.types import FloatArray
from planning.kinematics.chain import ToolPose
from planning.kinematics.goals import GoalError, PoseGoal, PositionBox, PositionSphere, checked_pose
from tests.planning.chains import chain, random_positions

NONE = (0.0, 0.0, 0.0, 1.0)
QUARTER = (0.0, 0.0, math.sin(math.pi / 4.0), math.cos(math.pi / 4.0))
REGIONS = [
    (PositionSphere(0.02), (0.05, 0.2, 0.1)),
    (PositionSphere(0.02), (0.05, 0.2, math.pi)),
    (PositionBox((0.02, 0.04, 0.06), (0.5, 0.5, 0.5, 0.5)), (0.3, 4.0, math.pi)),
    (PositionSphere(0.02), (4.0, 4.0, 4.0)),
    (PositionSphere(0.02), (0.05, 0.2, 0.1), "xyz_euler"),
    (PositionSphere(0.02), (0.05, 0.2, 4.0), "xyz_euler"),
]


@pytest.mark.parametrize(
    ("position", "quaternion", "message"),
    [
        ((math.nan, 0.0, 0.0), NONE, "x of the goal's position is nan: send a finite number"),
        ((0.0, -math.inf, 0.0), NONE, "y of the goal's position is -inf: send a finite number"),
        ((0.0, 0.0, 250e3), NONE, "z of the goal's position is 250000 m, above 1000 m: send meters"),
        ((0.0, 0.0), NONE, "the goal's position needs 3 numbers (x, y, z), not 2"),
        ((0.0, 0.0, 0.0), (0.0, math.nan, 0.0, 1.0), "y of the goal's orientation is nan: send a finite number"),
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), "the goal's orientation needs 4 numbers (x, y, z, w), not 3"),
        (
            (0.0, 0.0, 0.0),
            (0.0,) * 4,
            "the quaternion of the goal's orientation has length 0: send w 1 for no rotation",
        ),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 2.0), "the quaternion of the goal's orientation has length 2: normalize it"),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.9989), "has length 0.9989: normalize it to length 1"),
        ((0.0, 0.0, 0.0), (1e200, 1e200, 0.0, 0.0), "has length 1.41421e+200: normalize it"),
    ],
)
def test_a_wrong_pose_is_refused(position: Any, quaternion: Any, message: str) -> None:
    with pytest.raises(GoalError) as caught:
        checked_pose(position, quaternion)
    assert message in str(caught.value)
    assert caught.value.code == "INVALID_GOAL_CONSTRAINTS"


@pytest.mark.parametrize(
    ("region", "tolerance", "message"),
    [
        (PositionSphere(0.0), (0.1,) * 3, "the position tolerance is 0 m: send a finite number above 0"),
        (PositionSphere(math.nan), (0.1,) * 3, "the position tolerance is nan m"),
        (PositionBox((0.1, -0.1, 0.1)), (0.1,) * 3, "the size of the position region along y is -0.1 m"),
        (PositionBox((0.1, 0.1, 0.1), (0.0,) * 4), (0.1,) * 3, "orientation has length 0"),
        (
            PositionSphere(0.1),
            (0.1, 0.1, 0.0),
            "the orientation tolerance about z is 0 rad: send a finite number above 0",
        ),
        (PositionSphere(0.1), (math.inf, 0.1, 0.1), "the orientation tolerance about x is inf rad"),
    ],
)
def test_wrong_tolerances_are_refused(region: Any, tolerance: Any, message: str) -> None:
    with pytest.raises(GoalError) as caught:
        PoseGoal(ToolPose(np.zeros(3), np.array(NONE)), region, tolerance)
    assert message in str(caught.value)


def test_a_rounded_quaternion_is_normalized() -> None:
    pose = checked_pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.7074, 0.7074))
    assert pose.quaternion_xyzw == pytest.approx(QUARTER, abs=1e-12)


@pytest.mark.parametrize(
    ("region", "tolerance", "offset", "turn", "inside"),
    [
        (PositionSphere(0.01), (0.1,) * 3, (0.0099, 0.0, 0.0), NONE, True),
        (PositionSphere(0.01), (0.1,) * 3, (0.008, 0.008, 0.0), NONE, False),
        (PositionBox((0.02, 0.04, 0.06)), (0.1,) * 3, (0.0099, -0.0199, 0.0299), NONE, True),
        (PositionBox((0.02, 0.04, 0.06)), (0.1,) * 3, (0.0101, 0.0, 0.0), NONE, False),
        (PositionBox((0.02, 0.04, 0.06), QUARTER), (0.1,) * 3, (0.0199, 0.0099, 0.0), NONE, True),
        (PositionBox((0.02, 0.04, 0.06), QUARTER), (0.1,) * 3, (0.0, 0.0199, 0.0), NONE, False),
        (PositionSphere(0.01), (0.1, 0.1, 1.58), (0.0, 0.0, 0.0), QUARTER, True),
        (PositionSphere(0.01), (1.58, 1.58, 0.1), (0.0, 0.0, 0.0), QUARTER, False),
        (PositionSphere(0.01), (0.1, 0.1, math.pi), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), True),
        (PositionSphere(0.01), (0.1, math.pi, 0.1), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), False),
        (PositionSphere(0.01), (4.0, 4.0, 4.0), (0.0, 0.0, 0.0), (0.6, 0.0, 0.8, 0.0), True),
    ],
)
def test_a_region_contains_what_its_tolerances_allow(
    region: Any, tolerance: Any, offset: Any, turn: Any, inside: bool
) -> None:
    """``offset`` is given along the axes of the base, ``turn`` about the axes of the goal."""
    goal = PoseGoal(ToolPose(np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.5, 0.5, 0.5])), region, tolerance)
    tool = np.eye(4)
    tool[:3, :3] = matrices(goal.pose.quaternion_xyzw) @ matrices(np.array(turn))
    tool[:3, 3] = goal.pose.position_m + offset
    assert goal.contains(tool[None])[0] == inside


@pytest.mark.parametrize(
    ("angles", "tilt_rad", "inside"),
    [
        ("xyz_euler", 0.049, True),
        ("xyz_euler", 0.051, False),
        ("rotation_vector", 0.049, False),
        ("rotation_vector", 0.03, True),
    ],
)
def test_the_tilt_that_a_free_axis_leaves_depends_on_the_meaning_of_the_angles(
    angles: Any, tilt_rad: float, inside: bool
) -> None:
    """After a half turn about z, a tilt of 0.03 rad about x is a rotation vector with x at 0.047."""
    goal = PoseGoal(ToolPose(np.zeros(3), np.array(NONE)), PositionSphere(0.01), (0.05, 0.05, math.pi), angles)
    tool = np.eye(4)
    tilt, turn = (math.sin(tilt_rad / 2.0), 0.0, 0.0, math.cos(tilt_rad / 2.0)), (0.0, 0.0, 1.0, 0.0)
    tool[:3, :3] = matrices(np.array(tilt)) @ matrices(np.array(turn))
    assert goal.contains(tool[None])[0] == inside


@settings(max_examples=40)
@given(st.sampled_from(REGIONS), st.sampled_from([0.0, 0.9]), st.integers(0, 10_000))
def test_the_jacobian_of_the_excess_is_its_derivative(region: Any, share: float, seed: int) -> None:
    at, to = random_positions("robot_arm", 2, seed)
    near = to + (at - to) * (0.02 if seed % 2 else 0.6)
    goal = PoseGoal(chain("robot_arm").pose(to), *region)
    excess, slopes = goal.excess_and_slopes(*chain("robot_arm").transforms_and_jacobians(near[None]), share)
    assert slopes[0] == pytest.approx(_differences(goal, near, share), abs=2e-5)
    assert excess == pytest.approx(goal.excess(chain("robot_arm").transforms(near[None]), share))


def _differences(goal: PoseGoal, positions: FloatArray, share: float) -> FloatArray:
    step = 1e-6 * np.eye(len(positions))
    after, before = (goal.excess(chain("robot_arm").transforms(positions + sign * step), share) for sign in (1.0, -1.0))
    return (after - before).T / 2e-6
