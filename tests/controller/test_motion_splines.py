"""Test ros2_control's splines: their degrees, their ends, and limits that ros2_control itself does not check."""

import numpy as np
import pytest
from hypothesis import given, settings

from controller.motion import Kinematics, MotionError
from controller.trajectory.goal import GoalPoint
from controller.trajectory.splines import spline
from controller.trajectory.waypoints import Waypoints
from tests.controller.waypoints import JOINTS, LIMITS, assert_within, at_rest, random_waypoints, waypoints

START = at_rest(0.0, 0.0)
MOVING = Kinematics(np.array([0.0, 0.0]), np.array([0.4, -0.2]), np.array([0.5, 0.1]))
P, V, A = (1.0, -0.5), (0.3, 0.2), (0.4, -0.3)


@pytest.mark.parametrize(
    ("first", "middle"),
    [
        (GoalPoint(P, 2.0), (0.5, 0.0, 0.5, 0.0)),
        # ros2_control's formula: p = (3 s² - 2 s³) w + (s³ - s²) T v1 at s = 1/2, and its slope
        (GoalPoint(P, 2.0, V), (0.5 - 0.3 * 2 / 8, -0.25 + 0.0, 0.75 - 0.3 / 4, 0.0)),
    ],
)
def test_a_spline_from_rest_is_correct_at_half_time(first: GoalPoint, middle: tuple[float, ...]) -> None:
    path = spline(START, waypoints(first, GoalPoint(P, 4.0, (0.0, 0.0))), LIMITS)
    state = path.sample(1.0)
    assert state.position[0] == pytest.approx(middle[0])
    assert state.velocity[0] == pytest.approx(middle[2])
    assert not path.duration_s > 4.0


@pytest.mark.parametrize("start", [START, MOVING], ids=["from rest", "moving"])
@pytest.mark.parametrize(("velocity", "acceleration"), [((), ()), (V, ()), (V, A)], ids=["linear", "cubic", "quintic"])
def test_a_segment_matches_all_values_at_both_ends(
    start: Kinematics, velocity: tuple[float, ...], acceleration: tuple[float, ...]
) -> None:
    path = spline(start, waypoints(GoalPoint(P, 2.0, velocity, acceleration), GoalPoint((0.0, 0.0), 4.0)), LIMITS)
    begin, end = path.sample(0.0), path.sample(2.0 - 1e-12)
    assert begin.position == pytest.approx(start.position)
    assert end.position == pytest.approx(P)
    if velocity:
        assert begin.velocity == pytest.approx(start.velocity)
        assert end.velocity == pytest.approx(velocity)
    else:
        assert begin.velocity == pytest.approx(np.array(P) / 2.0)
    if acceleration:
        assert begin.acceleration == pytest.approx(start.acceleration)
        assert end.acceleration == pytest.approx(acceleration)


def test_the_degree_of_a_segment_depends_on_both_ends() -> None:
    path = spline(START, waypoints(GoalPoint((1.0, 0.0), 1.0, (0.0, 0.0)), GoalPoint((2.0, 0.0), 2.0)), LIMITS)
    assert path.sample(0.25).velocity[0] == pytest.approx(1.125)  # a cubic: 6 s (1 - s)
    assert path.sample(1.25).velocity[0] == pytest.approx(1.0)  # linear, because the last point has no velocity


def test_a_spline_rests_at_its_first_and_last_points() -> None:
    path = spline(START, waypoints(GoalPoint(P, 2.0, V)), LIMITS)
    assert path.sample(-1.0).position == pytest.approx((0.0, 0.0))
    for time_s in (2.0, 5.0):
        assert path.sample(time_s).position == pytest.approx(P)
        assert path.sample(time_s).velocity == pytest.approx((0.0, 0.0))  # The last point is reached at rest.


@pytest.mark.slow
@given(random_waypoints())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_random_splines_keep_the_limits_or_are_rejected(way: Waypoints) -> None:
    try:
        path = spline(START, way, LIMITS, JOINTS)
    except MotionError as error:
        assert "would swing to" in str(error)  # From rest, there is always a speed that is low enough.
        return
    assert_within(path, jerk=False)
    assert path.duration_s >= path.asked_s - 1e-9
    for starts_s, position in zip((*path.starts_s[1:], path.duration_s), way.position, strict=True):
        assert path.sample(starts_s).position == pytest.approx(position, abs=1e-6)


def test_a_duration_that_is_too_short_is_stretched_for_all_joints() -> None:
    path = spline(START, waypoints(GoalPoint((2.0, 2.0), 0.5)), LIMITS)  # The limit of the second joint is 2 rad/s.
    assert path.duration_s == pytest.approx(1.0)
    assert path.sample(0.5).position == pytest.approx((1.0, 1.0))


def test_a_cubic_that_swings_beyond_a_limit_is_rejected_with_the_values() -> None:
    near = GoalPoint((2.95, 0.0), 2.0, (3.0, 0.0))
    with pytest.raises(MotionError, match=r"a would swing to 3\.\d+ on the way to point #1, outside its limits -3"):
        spline(START, waypoints(near, GoalPoint((0.0, 0.0), 4.0, (0.0, 0.0))), LIMITS, JOINTS)
