"""A motion that goes on only as long as somebody says so."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nodes.handling.guided_motion import AHEAD_S, BRAKE_S, GuidedMotion

TICK_S = 0.05
FASTEST = 0.25
LOWER, UPPER = np.array([-1.0, -0.5]), np.array([1.0, 0.5])


@given(
    st.lists(st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25)), max_size=120),
    st.tuples(st.floats(-1.0, 1.0), st.floats(-0.5, 0.5)),
)
def test_whatever_is_said_ways_stay_within_the_limits_slow_and_end_at_rest(
    said: list[tuple[float, float]], start: tuple[float, float]
) -> None:
    motion = GuidedMotion(np.array(start), LOWER, UPPER)
    for velocity in said:
        before = motion.position
        motion.go(np.array(velocity), FASTEST, TICK_S)
        assert (np.abs(motion.position - before) <= FASTEST * TICK_S + 1e-9).all()
        on, rest = motion.way()
        assert on.time_s == AHEAD_S and rest.time_s == AHEAD_S + BRAKE_S <= 0.3
        assert not rest.velocity.any()
        for point in (motion, on, rest):
            assert (point.position >= LOWER).all() and (point.position <= UPPER).all()


@given(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)))
def test_a_pose_is_reached_and_one_outside_the_limits_as_far_as_they_go(pose: tuple[float, float]) -> None:
    motion, target = GuidedMotion(np.zeros(2), LOWER, UPPER), np.array(pose)
    for _ in range(500):
        if motion.go_to(target, FASTEST, TICK_S):
            break
    else:
        raise AssertionError(motion.position)
    np.testing.assert_allclose(motion.position, np.clip(target, LOWER, UPPER), atol=2e-3)


def test_a_joint_that_stands_outside_may_come_in_and_goes_no_further_out() -> None:
    motion = GuidedMotion(np.array([1.2, 0.0]), LOWER, UPPER)
    motion.go(np.array([0.25, 0.0]), FASTEST, 1.0)
    assert motion.position[0] == 1.2
    for _ in range(40):
        motion.go(np.array([-0.25, 0.0]), FASTEST, TICK_S)
    assert motion.position[0] < 1.0


def test_the_end_is_rest_at_once() -> None:
    motion = GuidedMotion(np.zeros(2), LOWER, UPPER)
    for _ in range(10):
        motion.go(np.array([0.25, 0.0]), FASTEST, TICK_S)
    at, speed = motion.position[0], motion.velocity[0]
    (rest,) = motion.end()
    assert rest.time_s == BRAKE_S and rest.position[0] - at <= speed * BRAKE_S / 2.0 + 1e-9 and not rest.velocity.any()
