"""Guided motions, which continue only while commands arrive."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nodes.handling.guided_motion import FURTHEST, HORIZON_S, NEAR, GuidedMotion, Standing

TICK_S = 0.05
FASTEST = np.array([0.25, 0.1])
LOWER, UPPER = np.array([-1.0, -0.5]), np.array([1.0, 0.5])
LAGS = 0.4
"""Share of the distance to the set point that a joint covers in each tick."""

joints = st.tuples(st.floats(-1.0, 1.0), st.floats(-0.5, 0.5))


def motion_from(position: np.ndarray) -> GuidedMotion:
    return GuidedMotion(position, LOWER, UPPER, FASTEST)


def follows(position: np.ndarray) -> Standing:
    """Return joints that are at their commanded positions."""
    return Standing(position, position)


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(0.0, 9.0)), max_size=60), joints)
def test_the_set_point_always_stays_within_the_limits_and_near_the_joints(
    said: list[tuple[float, float, float]], start: tuple[float, float]
) -> None:
    motion, position = motion_from(np.array(start)), np.array(start)
    for first, second, passed_s in said:
        set_point = motion.go(np.array([first, second]), passed_s, follows(position))
        assert (set_point >= LOWER).all() and (set_point <= UPPER).all()
        assert (np.abs(set_point - position) <= FASTEST * HORIZON_S + 1e-9).all()
        position = position + LAGS * (set_point - position)


def test_the_set_point_does_not_run_away_from_joints_at_rest() -> None:
    motion = motion_from(np.zeros(2))
    for _ in range(100):
        set_point = motion.go(FASTEST, TICK_S, follows(np.zeros(2)))
    np.testing.assert_allclose(set_point, FASTEST * HORIZON_S)


def test_a_blocked_joint_is_not_pushed_further() -> None:
    motion, commanded = motion_from(np.zeros(2)), np.zeros(2)
    for _ in range(100):
        commanded = motion.go(FASTEST, TICK_S, Standing(commanded, np.zeros(2)))
    np.testing.assert_allclose(commanded, FURTHEST)


@given(joints, st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)))
def test_a_pose_is_reached_as_far_as_the_limits_allow(start: tuple[float, float], pose: tuple[float, float]) -> None:
    motion, position, target = motion_from(np.array(start)), np.array(start), np.array(pose)
    for _ in range(500):
        if motion.go_to(target, TICK_S, follows(position)):
            break
        position = position + LAGS * (motion.set_point - position)
    else:
        raise AssertionError(position)
    np.testing.assert_allclose(position, np.clip(target, LOWER, UPPER), atol=NEAR)


def test_all_joints_reach_a_pose_at_the_same_time() -> None:
    motion = motion_from(np.zeros(2))
    motion.go_to(np.array([0.5, -0.1]), TICK_S, follows(np.zeros(2)))
    first, second = motion.set_point
    np.testing.assert_allclose([first, second], [FASTEST[0] * TICK_S, -FASTEST[0] * TICK_S / 5.0])


def test_a_joint_outside_its_limits_can_only_move_back_inside() -> None:
    position = np.array([1.2, 0.0])
    motion = motion_from(position)
    assert motion.go(np.array([0.25, 0.0]), TICK_S, follows(position))[0] == 1.2
    for _ in range(60):
        position = position + LAGS * (motion.go(np.array([-0.25, 0.0]), TICK_S, follows(position)) - position)
    assert position[0] < 1.0
