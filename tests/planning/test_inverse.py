"""Inverse kinematics solves poses that forward kinematics has reached, and refuses all others with the nearest pose."""

import contextlib
import math
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.rotations import matrices, quaternions
from hal.types import FloatArray, JointLimits
from planning.kinematics.chain import Chain, ToolPose
from planning.kinematics.goals import (
    ROTATION_M,
    CollidingError,
    PoseGoal,
    PositionBox,
    PositionSphere,
    UnreachableError,
)
from planning.kinematics.inverse import DISTINCT, InverseKinematics
from planning.planning_errors import PlanningError
from tests.planning.chains import SHARES, around, at_shares, chain, limits, model, random_positions

ARMS = ("robot_arm", "so101")
SOLVERS = {arm: InverseKinematics(chain(arm)) for arm in ARMS}
AT_ONCE_S = 1.0
"""Maximum processor time of an answer, in seconds."""


def start(arm: str) -> FloatArray:
    return np.zeros(len(chain(arm).names))


def turned(seed: int) -> FloatArray:
    quaternion = np.random.default_rng(seed).normal(size=4)
    return quaternion / np.linalg.norm(quaternion)


def far(seed: int) -> FloatArray:
    """Return a position between 0.8 and 1.5 m from the base; the arms reach at most 0.6 m."""
    random = np.random.default_rng(seed)
    direction = random.normal(size=3)
    return direction / np.linalg.norm(direction) * random.uniform(0.8, 1.5)


def solved(arm: str, seed: int, number: int) -> tuple[int, float]:
    """Return the number of reachable poses that are solved, and the longest processor time, in seconds."""
    count, longest_s = 0, 0.0
    for positions in random_positions(arm, number, seed):
        goal, began_s = around(arm, positions), time.process_time()
        with contextlib.suppress(UnreachableError):
            count += check(arm, goal, SOLVERS[arm].solve(goal, start(arm)))
        longest_s = max(longest_s, time.process_time() - began_s)
    return count, longest_s


def check(arm: str, goal: PoseGoal, solutions: FloatArray) -> int:
    """Check the solutions of a goal and return 1."""
    one = chain(arm)
    assert goal.contains(one.transforms(solutions)).all()
    assert ((solutions >= one.lower) & (solutions <= one.upper)).all()
    distances = np.linalg.norm(solutions - start(arm), axis=1)
    assert (np.diff(distances) >= 0.0).all()
    gaps = np.abs(solutions[:, None] - solutions).max(axis=2) + np.eye(len(solutions))
    assert gaps.min() >= DISTINCT
    return 1


@pytest.mark.parametrize("arm", ARMS)
def test_solutions_are_exact_if_the_pose_can_be_reached_exactly(arm: str) -> None:
    for positions in random_positions(arm, 10, seed=12):
        goal = around(arm, positions, tolerance_m=0.05, tolerance_rad=0.3)
        solutions = SOLVERS[arm].solve(goal, start(arm))
        assert goal.distances(chain(arm).transforms(solutions)).max() < 2e-6


@pytest.mark.parametrize("arm", ARMS)
def test_reachable_poses_are_solved(arm: str) -> None:
    count, longest_s = solved(arm, seed=1, number=25)
    assert count == 25
    assert longest_s < AT_ONCE_S


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_nearly_all_of_500_reachable_poses_are_solved(arm: str) -> None:
    count, longest_s = solved(arm, seed=2, number=500)
    assert count >= 0.995 * 500
    assert longest_s < AT_ONCE_S


def refused(arm: str, number: int) -> float:
    """Check that poses out of reach are refused, and return the longest processor time, in seconds."""
    longest_s = 0.0
    for seed in range(number):
        goal = PoseGoal(ToolPose(far(seed), turned(seed)), PositionSphere(0.005), (0.05,) * 3)
        began_s = time.process_time()
        with pytest.raises(UnreachableError) as caught:
            SOLVERS[arm].solve(goal, start(arm))
        longest_s = max(longest_s, time.process_time() - began_s)
        error = caught.value
        assert error.code == "NO_IK_SOLUTION"
        assert error.nearest.position_m == pytest.approx(chain(arm).pose(error.positions).position_m)
        assert error.distance_m == pytest.approx(float(np.linalg.norm(far(seed) - error.nearest.position_m)))
        assert f"the nearest pose is {error.distance_m:.3f} m and {error.angle_rad:.2f} rad away" in str(error)
    return longest_s


@pytest.mark.parametrize("arm", ARMS)
def test_poses_out_of_reach_are_refused_with_the_nearest_pose(arm: str) -> None:
    assert refused(arm, 3) < AT_ONCE_S


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_200_poses_out_of_reach_are_refused(arm: str) -> None:
    assert refused(arm, 200) < AT_ONCE_S


def test_the_nearest_pose_is_as_near_as_the_arm_can_come() -> None:
    """The stretched robot_arm reaches 0.59 m above its base."""
    goal = PoseGoal(
        ToolPose(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.0, 1.0])), PositionSphere(0.005), (math.pi,) * 3
    )
    with pytest.raises(UnreachableError) as caught:
        SOLVERS["robot_arm"].solve(goal, start("robot_arm"))
    assert caught.value.distance_m == pytest.approx(1.0 - 0.59, abs=1e-3)
    assert caught.value.angle_rad == 0.0


@pytest.mark.parametrize("arm", ARMS)
def test_no_random_pose_is_nearer_than_the_nearest_pose(arm: str) -> None:
    samples = chain(arm).transforms(random_positions(arm, 20_000, seed=13))
    for seed in range(3):
        inner = chain(arm).pose(random_positions(arm, 1, seed)[0]).position_m
        goal = PoseGoal(ToolPose(inner, turned(seed)), PositionSphere(1e-3), (1e-3,) * 3)
        with pytest.raises(UnreachableError) as caught:
            SOLVERS[arm].solve(goal, start(arm))
        found = math.hypot(caught.value.distance_m, ROTATION_M * caught.value.angle_rad)
        assert found <= np.linalg.norm(goal.distances(samples) * (1.0, ROTATION_M), axis=1).min()


@pytest.mark.parametrize("beyond_rad", [0.2, 0.5, 1.0])
def test_the_nearest_position_beyond_a_limit_is_straight_beside_the_goal(beyond_rad: float) -> None:
    """With joint1 at its limit, the tool moves in a vertical plane, and the goal is projected onto this plane."""
    narrow = {**limits("robot_arm"), "joint1": JointLimits(-0.5, 0.5, 1.0, 1.0, 1.0)}
    one = Chain(model("robot_arm"), narrow, "gripper_base_link")
    at = np.array([0.5, -0.6, -0.5, -0.4, -0.3, 0.0])
    x, y, z = one.pose(at + np.eye(6)[0] * beyond_rad).position_m.tolist()
    goal = PoseGoal(
        ToolPose(np.array([x, y, z]), np.array([0.0, 0.0, 0.0, 1.0])), PositionSphere(0.005), (math.pi,) * 3
    )
    with pytest.raises(UnreachableError) as caught:
        InverseKinematics(one).solve(goal, np.zeros(6))
    assert caught.value.positions[0] == 0.5
    assert caught.value.distance_m == pytest.approx(math.hypot(x, y) * math.sin(beyond_rad), rel=1e-3)


@settings(max_examples=10)
@given(st.sampled_from(ARMS), SHARES)
def test_solutions_are_inside_the_region_and_the_limits(arm: str, shares: list[float]) -> None:
    goal = around(arm, at_shares(arm, shares), tolerance_m=1e-3, tolerance_rad=0.01)
    assert check(arm, goal, SOLVERS[arm].solve(goal, start(arm)))


@pytest.mark.parametrize(
    ("region", "tolerance_rad"),
    [
        (PositionSphere(0.005), (0.3, 0.3, math.pi)),
        (PositionSphere(0.005), (math.pi, math.pi, 0.3)),
        (PositionBox((0.1, 0.1, 0.02)), (0.3, 0.3, 0.3)),
    ],
)
def test_a_five_joint_arm_uses_the_tolerances_of_a_pose_that_it_cannot_reach_exactly(
    region: PositionSphere | PositionBox, tolerance_rad: tuple[float, float, float]
) -> None:
    for positions in random_positions("so101", 2, seed=3):
        pose = chain("so101").pose(positions)
        shifted = PoseGoal(ToolPose(pose.position_m, _tilted(pose.quaternion_xyzw)), region, tolerance_rad)
        assert check("so101", shifted, SOLVERS["so101"].solve(shifted, start("so101")))
        exact = PoseGoal(shifted.pose, PositionSphere(1e-6), (1e-6,) * 3)
        with pytest.raises(UnreachableError):
            SOLVERS["so101"].solve(exact, start("so101"))


def _tilted(quaternion: FloatArray) -> FloatArray:
    """Turn an orientation by 0.2 rad about y of the tool, which SO-101 cannot do at a fixed position."""
    tilted = quaternion + 0.1 * np.array([-quaternion[2], quaternion[3], quaternion[0], -quaternion[1]])
    return tilted / np.linalg.norm(tilted)


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("angles", ["rotation_vector", "xyz_euler"])
@pytest.mark.parametrize("tolerance_rad", [(0.05, 0.05, 0.05), (0.05, 0.05, math.pi), (0.5, 0.5, 0.5)])
def test_a_pose_shifted_within_its_tolerances_is_reached(arm: str, angles: Any, tolerance_rad: Any) -> None:
    """Neither arm reaches the shifted pose exactly, because both can move their tools in five directions only."""
    random = np.random.default_rng(9)
    for positions in random_positions(arm, 3, seed=10):
        tool = chain(arm).transforms(positions[None])[0]
        turn = matrices(_quaternion(random.uniform(-0.9, 0.9, 3) * np.minimum(tolerance_rad, 0.5) / 2.0))
        pose = ToolPose(tool[:3, 3] + random.uniform(-0.0025, 0.0025, 3), quaternions(tool[:3, :3] @ turn))
        goal = PoseGoal(pose, PositionSphere(0.005), tolerance_rad, angles)
        assert check(arm, goal, SOLVERS[arm].solve(goal, start(arm)))


def _quaternion(vector: FloatArray) -> FloatArray:
    angle_rad = float(np.linalg.norm(vector))
    return np.array([*(vector / angle_rad * math.sin(angle_rad / 2.0)), math.cos(angle_rad / 2.0)])


def test_the_first_solution_is_where_the_arm_already_is() -> None:
    positions = random_positions("robot_arm", 1, seed=4)[0]
    solutions = SOLVERS["robot_arm"].solve(around("robot_arm", positions), positions)
    assert solutions[0] == pytest.approx(positions, abs=1e-9)
    assert 1 < len(solutions) <= 8


def test_the_same_request_has_the_same_solutions() -> None:
    positions = random_positions("robot_arm", 1, seed=5)[0]
    goal = around("robot_arm", positions)
    again = InverseKinematics(chain("robot_arm")).solve(goal, start("robot_arm"))
    assert np.array_equal(SOLVERS["robot_arm"].solve(goal, start("robot_arm")), again)


def test_solutions_that_are_not_valid_are_left_out() -> None:
    goal = around("robot_arm", random_positions("robot_arm", 1, seed=6)[0])
    solutions = SOLVERS["robot_arm"].solve(goal, start("robot_arm"), valid=lambda at: at[2] < 0.0, count=3)
    assert check("robot_arm", goal, solutions)
    assert (solutions[:, 2] < 0.0).all()
    with pytest.raises(CollidingError, match="only at invalid joint positions") as caught:
        SOLVERS["robot_arm"].solve(goal, start("robot_arm"), valid=lambda _: False)
    assert caught.value.code == "GOAL_IN_COLLISION"
    assert goal.contains(chain("robot_arm").transforms(caught.value.positions[None]))[0]


def test_a_solution_is_checked_once() -> None:
    """Most starts of the SO-101 end in the same solution."""
    seen: list[FloatArray] = []
    goal = around("so101", random_positions("so101", 1, seed=8)[0])
    with pytest.raises(CollidingError):
        SOLVERS["so101"].solve(goal, start("so101"), valid=lambda at: bool(seen.append(at)))
    exact = [at for at in seen if goal.distances(chain("so101").transforms(at[None]))[0, 0] < 1e-6]
    assert len(exact) == 1


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ([0.0] * 5, "5 joint positions were sent for 6 joints: send one for each of joint1, joint2"),
        ([0.0, math.nan, 0.0, 0.0, 0.0, 0.0], "the position of joint2 is nan: send a finite number"),
    ],
)
def test_a_wrong_start_is_refused(positions: list[float], message: str) -> None:
    goal = around("robot_arm", start("robot_arm"))
    with pytest.raises(PlanningError, match=message) as caught:
        SOLVERS["robot_arm"].solve(goal, np.array(positions))
    assert caught.value.code == "INVALID_ROBOT_STATE"


def test_other_places_of_the_region_are_tried_if_its_center_collides() -> None:
    pose = chain("robot_arm").pose(random_positions("robot_arm", 1, seed=7)[0])
    goal = PoseGoal(pose, PositionSphere(0.05), (0.3,) * 3)

    def clear(at: FloatArray) -> bool:
        return float(np.linalg.norm(chain("robot_arm").pose(at).position_m - pose.position_m)) > 0.02

    assert check("robot_arm", goal, SOLVERS["robot_arm"].solve(goal, start("robot_arm"), valid=clear))


def test_the_start_is_tried_first() -> None:
    """The robot_arm reaches a pose in infinitely many ways, but only those near the start are valid here."""
    positions = random_positions("robot_arm", 1, seed=8)[0]
    goal = around("robot_arm", positions)

    def near(at: FloatArray) -> bool:
        return bool(np.abs(at - positions).max() < 0.01)

    solutions = SOLVERS["robot_arm"].solve(goal, positions, valid=near)
    assert solutions == pytest.approx(positions[None], abs=0.01)
    with pytest.raises(CollidingError):
        SOLVERS["robot_arm"].solve(goal, start("robot_arm"), valid=near)


def test_a_continuous_joint_does_not_turn_needlessly() -> None:
    free = {**limits("robot_arm"), "joint6": JointLimits(-math.inf, math.inf, 1.0, 1.0, 1.0)}
    one = Chain(model("robot_arm"), free, "gripper_base_link")
    positions = np.array([0.1, 0.5, 0.6, 0.4, 0.3, 9.0])
    goal = PoseGoal(one.pose(positions), PositionSphere(1e-3), (0.01,) * 3)
    solutions = InverseKinematics(one).solve(goal, positions + 0.1)
    assert np.abs(solutions[:, 5] - 9.1).max() <= math.pi
    assert np.abs(solutions[0] - positions).max() < 0.5
