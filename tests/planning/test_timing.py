"""Timing of a path: limits, ends, and clearance of the timed path."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.types import FloatArray, JointLimits
from planning.collision import Collisions, Margins
from planning.paths.blends import Corner
from planning.paths.request import PathRequest
from planning.paths.search import find_path
from planning.paths.smoothing import path_length, shortened
from planning.paths.thinning import thinned
from planning.paths.timing import PERIOD_S, scaled, timed
from planning.planning_errors import PlanningError
from planning.scene import Pose, Scene, SceneObject, Sphere
from tests.planning.arms import planar

ARM = planar()
FREE = Collisions(ARM, Scene().without("post").without("floor").allow("base", "lower"))
BLOCKED = Collisions(ARM, Scene())
LIMITS = (JointLimits(-3.0, 3.0, 1.5, 4.0, 40.0), JointLimits(-3.0, 3.0, 1.0, 2.0, 60.0))


@given(
    points=st.lists(st.tuples(st.floats(-2.5, 2.5), st.floats(-2.0, 2.0)), min_size=2, max_size=7),
    factors=st.tuples(st.sampled_from([0.1, 0.5, 1.0]), st.sampled_from([0.2, 1.0])),
)
@settings(max_examples=15, deadline=None)
def test_a_timed_path_keeps_all_limits(points, factors):
    limits = scaled(LIMITS, *factors)
    path = timed(np.array(points), limits, FREE)
    assert path.positions[0] == pytest.approx(points[0])
    assert path.positions[-1] == pytest.approx(points[-1], abs=1e-6)
    assert np.all(np.diff(path.times_s) > 0.0)
    for row in (0, -1):
        assert path.velocities[row] == pytest.approx([0.0, 0.0], abs=1e-6)
    steps_s = np.diff(path.times_s)[:, None]
    for column, limit in enumerate(limits):
        speed, acceleration = path.velocities[:, column], path.accelerations[:, column]
        assert np.abs(speed).max() <= limit.velocity * 1.0001
        assert np.abs(acceleration).max() <= limit.acceleration * 1.0001 + 1e-6
        # the differences between the points agree with the derivatives, so both are correct
        if len(steps_s):
            assert np.abs(np.diff(speed) / steps_s[:, 0]).max() <= limit.acceleration * 1.0001 + 1e-5
            assert np.abs(np.diff(path.positions[:, column]) / steps_s[:, 0]).max() <= limit.velocity * 1.0001 + 1e-5
            regular = steps_s[:, 0] > PERIOD_S / 2
            assert np.abs(np.diff(acceleration) / steps_s[:, 0])[regular].max(initial=0.0) <= limit.jerk * 1.001 + 1e-4


def test_corners_are_rounded_where_there_is_room_and_save_time():
    corner = np.array([[0.0, 0.0], [1.0, 0.5], [0.5, 1.5]])
    path = timed(corner, LIMITS, FREE)
    stopped = timed(corner[:2], LIMITS, FREE).duration_s + timed(corner[1:], LIMITS, FREE).duration_s
    assert path.duration_s < 0.95 * stopped
    assert np.linalg.norm(path.velocities[5:-5], axis=1).min() > 0.1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_planned_path_is_short_and_stays_clear_when_timed(seed):
    request = PathRequest(np.array([0.2, 0.0]), (np.array([1.4, 0.0]),), seed=seed)
    found = find_path(ARM, BLOCKED, request, lambda: 1.0)
    short = shortened(found, BLOCKED, Margins(), seed, lambda: 1.0)
    assert path_length(short) <= path_length(found)
    assert shortened(found, BLOCKED, Margins(), seed, lambda: 1.0).tolist() == short.tolist()
    path = timed(short, LIMITS, BLOCKED)
    at_s = np.linspace(0.0, path.duration_s, 2000)
    fine = np.array([np.interp(at_s, path.times_s, column) for column in path.positions.T]).T
    assert min(BLOCKED.clearance(positions).distance_m for positions in fine) >= 0.5e-3 - 2e-6


def test_a_corner_at_an_obstacle_is_not_cut():
    """The planar arm folds, passes the post and unfolds: a wide blend would touch the post."""
    path = np.array([[0.2, 0.0], [0.2, 2.0], [1.4, 2.0], [1.4, 0.0]])
    assert BLOCKED.path_contact(list(path)) is None
    timed_path = timed(path, LIMITS, BLOCKED)
    assert BLOCKED.path_contact(list(timed_path.positions)) is None


def test_a_path_that_touches_something_is_refused():
    with pytest.raises(PlanningError, match="brings left too close to post"):
        timed(np.array([[0.2, 0.0], [1.4, 0.0]]), LIMITS, BLOCKED)


@pytest.mark.parametrize("factor", [0.0, -1.0, 1.5, float("nan")])
def test_a_scaling_factor_outside_its_range_is_refused(factor):
    with pytest.raises(PlanningError, match="velocity scaling factor is"):
        scaled(LIMITS, factor)


def test_a_motion_that_would_take_longer_than_an_hour_is_refused():
    path = np.array([[0.0, 0.0], [1.0, 0.5]])
    with pytest.raises(PlanningError, match=r"would take \d+ s, which is longer than 3600 s: increase its speed"):
        timed(path, scaled(LIMITS, 1e-6), FREE)
    assert timed(path, scaled(LIMITS, 1e-2), FREE).duration_s > 60.0


def test_a_path_of_equal_points_takes_no_time():
    assert timed(np.array([[0.1, 0.2], [0.1, 0.2]]), LIMITS, FREE).duration_s == 0.0


def test_a_path_that_is_as_near_as_an_accepted_edge_may_be_is_timed():
    """The arm moves its tip along a wall, at a distance between the padding minus the tolerance and the padding."""
    wall = SceneObject("wall", ((Sphere(0.1), Pose()),), Pose(np.array([0.0, 1.1 + 0.1 + 0.0015, 0.15])))
    collisions = Collisions(ARM, Scene().without("post").with_object(wall))
    path = np.array([[0.9, 0.0], [2.0, 0.0]])
    margins = Margins(0.002, 0.001)
    nearest_m = min(
        collisions.clearance(path[0] + (path[1] - path[0]) * part).distance_m for part in np.linspace(0, 1, 999)
    )
    assert 0.001 < nearest_m < 0.002
    motion = timed(path, LIMITS, collisions, margins)
    assert motion.positions[-1] == pytest.approx(path[-1])


@pytest.mark.parametrize(
    ("padding_m", "tolerance_m"), [(0.0, 0.001), (0.001, 0.002), (0.001, 0.0), (float("nan"), 0.001)]
)
def test_margins_with_which_an_accepted_edge_could_touch_something_are_refused(padding_m, tolerance_m):
    with pytest.raises(ValueError, match="at most the padding"):
        Margins(padding_m, tolerance_m)


def spline(lasts_s: float, ends: tuple[FloatArray, FloatArray], slopes: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return 21 points (21, n) of the cubic between two points with these velocities."""
    t = np.linspace(0.0, 1.0, 21)[:, None]
    (one, other), (before, after) = ends, slopes
    rest = 1.0 - t
    return (
        rest**2 * (1.0 + 2.0 * t) * one
        + t**2 * (3.0 - 2.0 * t) * other
        + lasts_s * t * rest * (rest * before - t * after)
    )


def test_a_spline_through_the_points_keeps_the_clearance_of_the_check():
    path = np.array([[0.2, 0.0], [0.2, 2.0], [1.4, 2.0], [1.4, 0.0]])
    motion = timed(path, LIMITS, BLOCKED)
    rows = zip(
        np.diff(motion.times_s),
        itertools.pairwise(motion.positions),
        itertools.pairwise(motion.velocities),
        strict=True,
    )
    fine = np.concatenate([spline(*row) for row in rows])
    assert min(BLOCKED.clearance(positions).distance_m for positions in fine) >= 0.5e-3 - 2e-6


def test_neither_a_blend_nor_a_spline_is_farther_from_a_chord_than_its_sag():
    corner = Corner(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]), 0.1)
    step, shares = 0.02, np.linspace(0.0, 1.0, 21)[:, None]
    for begin in np.linspace(0.0, 0.2 - step, 19):
        (one, before, _), (other, after, _) = corner.at(begin), corner.at(begin + step)
        curve = np.array([corner.at(begin + step * float(share))[0] for share in shares[:, 0]])
        for line in (spline(step, (one, other), (before, after)), curve):
            farthest = np.abs(line - (one + (other - one) * shares)).max(axis=0)
            assert (farthest <= corner.sag(step) + 1e-12).all()


def test_points_near_the_lines_between_others_are_removed():
    path = np.array([[0.0, 0.0], [0.5, 1e-5], [1.0, 0.0], [1.0, 0.5], [1.0, 1.0]])
    assert thinned(path, np.array([1.0, 1.0]), 1e-4).tolist() == [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    assert len(thinned(path, np.array([1.0, 100.0]), 1e-4)) == 4
    assert thinned(np.zeros((3, 2)), np.ones(2), 1e-4).tolist() == [[0.0, 0.0], [0.0, 0.0]]
