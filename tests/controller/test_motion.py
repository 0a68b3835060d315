"""Test that motions stay within all limits, arrive exactly and take the requested time."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from controller.motion import Kinematics, MotionError, RuckigMotion, motion_to, plan_stop, segment, stretched
from hal.types import FloatArray, JointLimits

LOWER, UPPER = -3.0, 3.0
SLACK = 1e-6
"""Relative tolerance for rounding."""


def limits_of(velocity: float, acceleration: float, jerk: float) -> JointLimits:
    return JointLimits(LOWER, UPPER, velocity, acceleration, jerk)


bounds = st.builds(limits_of, st.floats(0.05, 10.0), st.floats(0.1, 50.0), st.floats(1.0, 1000.0))
positions = st.floats(LOWER, UPPER)


@st.composite
def tasks(draw: st.DrawFn) -> tuple[list[JointLimits], FloatArray, FloatArray]:
    """Return random limits, starts and targets of one to six joints."""
    count = draw(st.integers(1, 6))
    vectors = st.lists(positions, min_size=count, max_size=count).map(np.array)
    return draw(st.lists(bounds, min_size=count, max_size=count)), draw(vectors), draw(vectors)


def at_rest(*position: float) -> Kinematics:
    return Kinematics.at_rest(np.array(position))


def through(start: Kinematics, points: list[tuple[Kinematics, float]], limits: list[JointLimits]) -> RuckigMotion:
    """Join segments through states at their times."""
    before_s, trajectories = 0.0, []
    for state, time_s in points:
        trajectories.append(segment(start, state, limits, time_s - before_s))
        start, before_s = state, time_s
    return RuckigMotion.of(trajectories, before_s)


def samples(motion: RuckigMotion, count: int = 200) -> list[Kinematics]:
    return [motion.sample(t) for t in np.linspace(0.0, motion.duration_s, count)]


def assert_within(motion: RuckigMotion, limits: list[JointLimits]) -> None:
    velocity = np.array([limit.velocity for limit in limits])
    acceleration = np.array([limit.acceleration for limit in limits])
    jerk = np.array([limit.jerk for limit in limits])
    seen = samples(motion)
    step_s = motion.duration_s / (len(seen) - 1)
    for state in seen:
        assert (np.abs(state.velocity) <= velocity * (1 + SLACK) + 1e-9).all()
        assert (np.abs(state.acceleration) <= acceleration * (1 + SLACK) + 1e-9).all()
    for before, after in itertools.pairwise(seen):
        change = np.abs(after.acceleration - before.acceleration)
        assert (change <= jerk * step_s * (1 + 1e-4) + 1e-7 * acceleration + 1e-9).all()


@given(tasks(), st.floats(0.0, 8.0))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_motion_from_rest_to_rest_keeps_all_limits(
    task: tuple[list[JointLimits], FloatArray, FloatArray], asked_s: float
) -> None:
    limits, start, target = task
    motion = motion_to(Kinematics.at_rest(start), Kinematics.at_rest(target), limits, asked_s)
    fastest_s = motion_to(Kinematics.at_rest(start), Kinematics.at_rest(target), limits, 0.0).duration_s
    assert motion.duration_s == pytest.approx(max(asked_s, fastest_s), abs=1e-6)
    assert stretched(motion) == (fastest_s > asked_s + 1e-3)
    assert motion.sample(motion.duration_s).position == pytest.approx(target, abs=1e-7)
    assert motion.sample(motion.duration_s).velocity == pytest.approx(0.0, abs=1e-6)
    assert motion.sample(0.0).position == pytest.approx(start, abs=1e-9)
    assert_within(motion, limits)


@given(tasks(), st.floats(0.0, 1.0), st.floats(0.0, 5.0), st.data())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_motion_continues_from_the_state_of_another_within_the_limits(
    task: tuple[list[JointLimits], FloatArray, FloatArray], share: float, asked_s: float, data: st.DataObject
) -> None:
    limits, start, target = task
    first = motion_to(Kinematics.at_rest(start), Kinematics.at_rest(target), limits, 0.0)
    at = first.sample(share * first.duration_s)
    other = np.array(data.draw(st.lists(positions, min_size=len(start), max_size=len(start))))
    second = motion_to(at, Kinematics.at_rest(other), limits, asked_s)
    begin = second.sample(0.0)
    assert begin.position == pytest.approx(at.position, abs=1e-9)
    assert begin.velocity == pytest.approx(at.velocity, abs=1e-9)
    assert begin.acceleration == pytest.approx(at.acceleration, abs=1e-9)
    assert second.sample(second.duration_s).position == pytest.approx(other, abs=1e-6)
    assert_within(second, limits)
    for state in samples(second):
        assert (state.position >= LOWER - 1e-6).all()
        assert (state.position <= UPPER + 1e-6).all()


@given(tasks(), st.floats(0.0, 1.0))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_stop_ends_at_rest_within_the_limits(
    task: tuple[list[JointLimits], FloatArray, FloatArray], share: float
) -> None:
    limits, start, target = task
    motion = motion_to(Kinematics.at_rest(start), Kinematics.at_rest(target), limits, 0.0)
    stop = plan_stop(motion.sample(share * motion.duration_s), limits)
    end = stop.sample(stop.duration_s)
    assert end.velocity == pytest.approx(0.0, abs=1e-6)
    assert end.acceleration == pytest.approx(0.0, abs=1e-5)
    assert (end.position >= LOWER - 1e-6).all()
    assert (end.position <= UPPER + 1e-6).all()
    assert_within(stop, limits)


def test_a_stop_from_rest_takes_no_time() -> None:
    stop = plan_stop(at_rest(0.3, -0.2), [limits_of(1, 1, 1)] * 2)
    assert stop.duration_s == 0.0
    assert stop.sample(5.0).position == pytest.approx([0.3, -0.2])


@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-0.5, 0.5)), min_size=2, max_size=5),
    st.floats(0.2, 2.0),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_waypoints_are_passed_without_a_step_in_position_or_velocity(
    points: list[tuple[float, float]], apart_s: float
) -> None:
    limits = [limits_of(2.0, 10.0, 100.0)]
    *way, (last, _) = points
    states = [Kinematics(np.array([p]), np.array([v]), np.zeros(1)) for p, v in way]
    states.append(at_rest(last))
    try:
        motion = through(at_rest(0.0), [(s, (i + 1) * apart_s) for i, s in enumerate(states)], limits)
    except MotionError:
        assume(False)
        return
    assert_within(motion, limits)
    for start_s, state in zip(motion.starts_s[1:], states, strict=False):
        before, after = motion.sample(start_s - 1e-9), motion.sample(start_s)
        assert before.position == pytest.approx(after.position, abs=1e-6)
        assert before.velocity == pytest.approx(after.velocity, abs=1e-6)
        assert after.position == pytest.approx(state.position, abs=1e-6)
    assert motion.sample(motion.duration_s).position == pytest.approx([last], abs=1e-6)


def test_waypoints_are_passed_on_time_if_the_limits_allow() -> None:
    limits = [limits_of(2.0, 10.0, 100.0)]
    way = Kinematics(np.array([0.5]), np.array([0.4]), np.zeros(1))
    motion = through(at_rest(0.0), [(way, 1.0), (at_rest(1.0), 2.5)], limits)
    assert motion.sample(1.0).position == pytest.approx([0.5], abs=1e-6)
    assert motion.sample(1.0).velocity == pytest.approx([0.4], abs=1e-6)
    assert motion.duration_s == pytest.approx(2.5)
    assert not stretched(motion)


def test_a_motion_is_at_rest_before_its_start_and_after_its_end() -> None:
    motion = motion_to(at_rest(0.0), at_rest(1.0), [limits_of(2.0, 10.0, 100.0)], 1.5)
    assert motion.sample(-1.0).position == pytest.approx([0.0])
    assert motion.sample(9.0).position == pytest.approx([1.0])
    assert motion.sample(9.0).velocity == pytest.approx([0.0])


def test_a_motion_never_swings_beyond_the_position_limits() -> None:
    """A waypoint may be within the limits, but may be passed so fast that the joint cannot stay within them."""
    near_the_end = Kinematics(np.array([2.95]), np.array([4.0]), np.zeros(1))
    points = [(near_the_end, 3.0), (at_rest(0.0), 6.0)]
    with pytest.raises(MotionError, match=r"joint 1 would swing to 3\.\d+, outside its limits -3\.0+ to 3\.0+"):
        through(at_rest(0.0), points, [limits_of(4.0, 12.0, 120.0)])


def test_a_joint_outside_its_limits_may_return() -> None:
    motion = motion_to(at_rest(3.1), at_rest(0.0), [limits_of(4.0, 12.0, 120.0)], 3.0)
    assert motion.sample(0.0).position == pytest.approx([3.1])
    assert motion.sample(3.0).position == pytest.approx([0.0])


def test_no_joint_waits_for_another_in_a_stop() -> None:
    limits = [limits_of(4.0, 12.0, 120.0), limits_of(4.0, 1.0, 120.0)]
    both = Kinematics(np.zeros(2), np.array([2.0, 2.0]), np.zeros(2))
    alone = plan_stop(Kinematics(np.zeros(1), np.array([2.0]), np.zeros(1)), limits[:1])
    stop = plan_stop(both, limits)
    assert stop.sample(stop.duration_s).position[0] == pytest.approx(alone.sample(alone.duration_s).position[0])


def test_a_duration_that_ruckig_rejects_raises_motion_error() -> None:
    with pytest.raises(MotionError, match="cannot find a motion within the limits"):
        motion_to(at_rest(0.0), at_rest(0.5), [limits_of(2.0, 10.0, 100.0)], 1e9)


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("position", "velocity", "acceleration"),
    [(NAN, 0, 0), (INF, 0, 0), (0, NAN, 0), (0, 3.0, 0), (0, 0, NAN), (0, 0, 20.0)],
    ids=["NaN", "inf", "NaN v", "too fast", "NaN a", "too much a"],
)
def test_an_impossible_target_raises_motion_error(position: float, velocity: float, acceleration: float) -> None:
    target = Kinematics(np.array([position]), np.array([velocity]), np.array([acceleration]))
    with pytest.raises(MotionError):
        motion_to(at_rest(0.0), target, [limits_of(2.0, 10.0, 100.0)], 1.0)
