"""Test that the plans of each interpolation method stay within the limits, and that the plans can begin during any
motion."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from controller.motion import Kinematics, MotionError, stretched
from controller.trajectory.goal import GoalPoint
from controller.trajectory.goal_planner import Method, prepare
from controller.trajectory.paths import FEW, MISSES, PathTask
from controller.trajectory.smoothing import smooth_path
from controller.trajectory.waypoints import Waypoints
from tests.controller.waypoints import JOINTS, LIMITS, Trapezoid, assert_within, at_rest, random_waypoints, waypoints
from tests.drivers.fault_lines import CYCLES

START = at_rest(0.0, 0.0)
positions_ = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
METHODS: tuple[Method, ...] = ("splines", "ruckig", "none")


def task(way: Waypoints, start: Kinematics = START) -> PathTask:
    return PathTask(start, way, LIMITS, JOINTS)


@pytest.mark.soak
@given(random_waypoints())
@settings(max_examples=CYCLES // 40, deadline=None, derandomize=True)
def test_smoothed_paths_keep_all_limits_and_both_ends(way: Waypoints) -> None:
    try:
        path = smooth_path(START, way, LIMITS, JOINTS)
    except MotionError:
        assume(False)
        return
    assert_within(path)
    assert path.sample(0.0).position == pytest.approx((0.0, 0.0), abs=1e-9)
    for late_s in (0.0, 3.0):
        end = path.sample(path.duration_s + late_s)
        assert end.position == pytest.approx(way.position[-1], abs=1e-7)
        assert end.velocity == pytest.approx((0.0, 0.0), abs=1e-6)


@given(random_waypoints(largest=6))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_ruckig_keeps_all_limits_and_ends_at_the_last_point(way: Waypoints) -> None:
    try:
        path = prepare("ruckig", task(way)).join(START, 0.0)
    except MotionError:
        assume(False)
        return
    assert_within(path)
    assert path.sample(path.duration_s).position == pytest.approx(way.position[-1], abs=1e-6)
    assert path.duration_s >= path.asked_s - 1e-6


@given(st.lists(positions_, min_size=2, max_size=6), st.floats(0.1, 0.6))
@settings(max_examples=20, deadline=None, derandomize=True)
def test_a_path_whose_times_are_too_short_hardly_misses_any_of_few_points(
    points: list[tuple[float, float]], span_s: float
) -> None:
    way = waypoints(*(GoalPoint(point, span_s * number) for number, point in enumerate(points, 1)))
    try:
        path = prepare("ruckig", task(way)).join(START, 0.0)
    except MotionError:
        assume(False)
        return
    assert_within(path)
    samples = np.array([path.sample(time_s).position for time_s in np.arange(0.0, path.duration_s + 0.01, 0.005)])
    misses = [np.abs(samples - point).max(axis=1).min() for point in way.position]
    assert max(misses) <= MISSES + 0.005


@given(
    random_waypoints(largest=5),
    st.floats(0.0, 1.0),
    positions_,
)
@settings(max_examples=25, deadline=None, derandomize=True)
def test_a_plan_is_joined_from_any_motion_without_a_step(
    way: Waypoints, share: float, target: tuple[float, float]
) -> None:
    before = prepare("ruckig", task(waypoints(GoalPoint(target, 0.5)))).join(START, 0.0)
    moving = before.sample(share * before.duration_s)
    try:
        path = prepare("ruckig", task(way)).join(moving, 0.0)
    except MotionError:
        assume(False)
        return
    begin = path.sample(0.0)
    assert begin.position == pytest.approx(moving.position, abs=1e-9)
    assert begin.velocity == pytest.approx(moving.velocity, abs=1e-9)
    assert_within(path)
    assert path.sample(path.duration_s).position == pytest.approx(way.position[-1], abs=1e-6)


@pytest.mark.parametrize("fields", [1, 2, 3], ids=["positions", "velocities", "accelerations"])
@pytest.mark.parametrize("apart_s", [0.01, 0.02, 0.05, 0.1, 0.3])
@pytest.mark.parametrize(("velocity", "acceleration"), [(1.0, 1.0), (2.0, 6.0), (3.0, 10.0)])
def test_the_path_of_a_planner_ends_within_the_timeout_of_its_client(
    fields: int, apart_s: float, velocity: float, acceleration: float
) -> None:
    """MoveIt cancels after 1.1 times the duration plus 0.5 s."""
    profile = Trapezoid(1.9, velocity, acceleration)
    path = prepare("ruckig", task(profile.waypoints(apart_s, fields))).join(START, 0.0)
    assert_within(path)
    assert path.duration_s <= 1.1 * profile.duration_s + 0.4
    late_s = (path.duration_s - profile.duration_s) / 2.0
    deviation = [abs(path.sample(t + late_s).position[0] - profile.at(t)[0]) for t in np.arange(0.0, 0.6, 0.05)]
    assert max(deviation) < 0.12


def test_few_points_are_passed_exactly_on_time_without_stopping() -> None:
    way = waypoints(*(GoalPoint((0.4 * i, 0.2 * i), float(i)) for i in (1, 2, 3)))
    path = prepare("ruckig", task(way)).join(START, 0.0)
    for i in (1, 2):
        assert path.sample(float(i)).position == pytest.approx((0.4 * i, 0.2 * i), abs=1e-6)
        assert path.sample(float(i)).velocity[0] > 0.3
    assert not stretched(path)


@pytest.mark.parametrize("count", [FEW + 1, 500, 5000])
def test_many_points_are_sampled_as_cheaply_as_few(count: int) -> None:
    times = np.linspace(0.02, 0.02 * count, count)
    way = waypoints(*(GoalPoint((float(np.sin(t) - 0.0), float(0.3 * np.sin(2 * t))), float(t)) for t in times))
    path = prepare("ruckig", task(way)).join(START, 0.0)
    assert path.duration_s <= 0.02 * count + 0.6
    for t in (times[count // 2], times[-2]):
        assert path.sample(float(t) + 0.1).position[0] == pytest.approx(np.sin(t), abs=0.15)


@pytest.mark.parametrize("method", METHODS)
def test_points_that_passed_during_a_wait_are_skipped(method: Method) -> None:
    way = waypoints(GoalPoint((0.3, 0.0), 1.0), GoalPoint((0.6, 0.0), 3.0))
    path = prepare(method, task(way)).join(START, 1.5)
    assert path.asked_s == pytest.approx(1.5)
    assert path.duration_s == pytest.approx(1.5, abs=0.01)
    assert path.sample(1.51).position == pytest.approx((0.6, 0.0), abs=1e-3)


def test_the_method_none_leaps_to_the_next_point_at_each_points_time() -> None:
    way = waypoints(GoalPoint((0.1, 0.0), 1.0), GoalPoint((0.2, 0.0), 2.0), GoalPoint((0.3, 0.0), 3.0))
    path = prepare("none", task(way)).join(at_rest(0.5, 0.5), 0.0)
    seen = [float(path.sample(t).position[0]) for t in (0.0, 0.9, 1.0, 1.9, 2.0, 2.9, 3.0, 9.0)]
    assert seen == [0.5, 0.5, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3]


def test_splines_continue_from_an_unexpected_motion() -> None:
    way = waypoints(GoalPoint((0.5, 0.0), 1.0, (0.2, 0.0)), GoalPoint((0.6, 0.0), 2.0, (0.0, 0.0)))
    moving = Kinematics(np.array([0.1, 0.0]), np.array([0.3, 0.0]), np.zeros(2))
    path = prepare("splines", task(way)).join(moving, 0.0)
    assert path.sample(0.0).position == pytest.approx((0.1, 0.0))
    assert path.sample(0.0).velocity == pytest.approx((0.3, 0.0))
    assert path.sample(1.0).position == pytest.approx((0.5, 0.0))
    assert path.sample(2.0).position == pytest.approx((0.6, 0.0))
