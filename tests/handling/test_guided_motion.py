"""The set point of a manual motion stays near the joints and within their limits."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from controller.guided_motion import FURTHEST, HORIZON_S, NEAR, GuidedMotion, JointPositions

TICK_S = 0.05
FASTEST = np.array([0.25, 0.1])
LOWER, UPPER = np.array([-1.0, -0.5]), np.array([1.0, 0.5])
LAGS = 0.4
"""Fraction of the distance to the set point that the joints move in each tick."""

joints = st.tuples(st.floats(-1.0, 1.0), st.floats(-0.5, 0.5))


def motion_from(position: np.ndarray) -> GuidedMotion:
    return GuidedMotion(position, LOWER, UPPER, FASTEST)


def follows(position: np.ndarray) -> JointPositions:
    """Return the positions of joints that follow their commands exactly."""
    return JointPositions(position, position)


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(0.0, 9.0)), max_size=60), joints)
def test_set_point_stays_within_limits_and_near_the_joints(
    commands: list[tuple[float, float, float]], start: tuple[float, float]
) -> None:
    motion, position = motion_from(np.array(start)), np.array(start)
    for first, second, passed_s in commands:
        set_point = motion.go(np.array([first, second]), passed_s, follows(position))
        assert (set_point >= LOWER).all() and (set_point <= UPPER).all()
        assert (np.abs(set_point - position) <= FASTEST * HORIZON_S + 1e-9).all()
        position = position + LAGS * (set_point - position)


def test_set_point_waits_for_joints_that_do_not_move() -> None:
    motion = motion_from(np.zeros(2))
    for _ in range(100):
        set_point = motion.go(FASTEST, TICK_S, follows(np.zeros(2)))
    np.testing.assert_allclose(set_point, FASTEST * HORIZON_S)


def test_set_point_stays_near_a_blocked_joint() -> None:
    motion, commanded = motion_from(np.zeros(2)), np.zeros(2)
    for _ in range(100):
        commanded = motion.go(FASTEST, TICK_S, JointPositions(commanded, np.zeros(2)))
    np.testing.assert_allclose(commanded, FURTHEST)


@given(joints, st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)))
def test_pose_is_reached_within_the_limits(start: tuple[float, float], pose: tuple[float, float]) -> None:
    motion, position, target = motion_from(np.array(start)), np.array(start), np.array(pose)
    for _ in range(500):
        if motion.go_to(target, TICK_S, follows(position)):
            break
        position = position + LAGS * (motion.set_point - position)
    else:
        raise AssertionError(position)
    np.testing.assert_allclose(position, np.clip(target, LOWER, UPPER), atol=NEAR)


def test_joints_reach_a_pose_together() -> None:
    motion = motion_from(np.zeros(2))
    motion.go_to(np.array([0.5, -0.1]), TICK_S, follows(np.zeros(2)))
    first, second = motion.set_point
    np.testing.assert_allclose([first, second], [FASTEST[0] * TICK_S, -FASTEST[0] * TICK_S / 5.0])


def test_joint_outside_its_limits_can_only_move_inside() -> None:
    position = np.array([1.2, 0.0])
    motion = motion_from(position)
    assert motion.go(np.array([0.25, 0.0]), TICK_S, follows(position))[0] == 1.2
    for _ in range(60):
        position = position + LAGS * (motion.go(np.array([-0.25, 0.0]), TICK_S, follows(position)) - position)
    assert position[0] < 1.0
