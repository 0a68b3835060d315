"""A spline through the points of a smooth path can be followed within the limits of every joint."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.types import JointLimits
from planning.collision import Collisions, Margins
from planning.paths.smooth_timing import Spline, timed_smoothly
from planning.paths.timing import scaled
from planning.scene import Scene
from tests.planning.arms import planar

ARM = planar()
FREE = Collisions(ARM, Scene().without("post").without("floor").allow("base", "lower"))
LIMITS = (JointLimits(-3.0, 3.0, 1.5, 4.0, 40.0), JointLimits(-3.0, 3.0, 1.0, 2.0, 60.0))
ANGLES = st.floats(-2.0, 2.0)


@given(corners=st.lists(st.tuples(ANGLES, ANGLES), min_size=2, max_size=4), count=st.integers(2, 20))
@settings(max_examples=30, deadline=None)
def test_limits_hold_and_the_motion_begins_and_ends_at_rest(corners: list[tuple[float, float]], count: int) -> None:
    shares = np.linspace(0.0, 1.0, count)
    turns = np.cumsum(np.array(corners), axis=0) * 0.1
    path = np.array([[np.polynomial.polynomial.polyval(share, column) for column in turns.T] for share in shares])
    motion = timed_smoothly(path, LIMITS, FREE, Margins())
    if motion is None:
        assert np.allclose(path, path[0])
        return
    for joint, limit in enumerate(LIMITS):
        assert np.abs(motion.velocities[:, joint]).max() <= limit.velocity + 1e-6
        assert np.abs(motion.accelerations[:, joint]).max() <= limit.acceleration + 1e-6
        jerks = np.diff(motion.accelerations[:, joint]) / np.diff(motion.times_s)
        assert np.abs(jerks).max(initial=0.0) <= limit.jerk * 1.001 + 1e-6
    assert motion.positions[[0, -1]] == pytest.approx(path[[0, -1]])
    assert motion.velocities[[0, -1]] == pytest.approx(0.0)


def test_the_duration_hardly_depends_on_the_number_of_points() -> None:
    durations = []
    for count in (8, 30, 200):
        angles = np.linspace(0.0, 1.0, count)
        path = np.stack([np.sin(angles), np.cos(angles)], axis=1)
        motion = timed_smoothly(path, LIMITS, FREE, Margins())
        assert motion is not None
        durations.append(motion.duration_s)
    assert max(durations) < 1.15 * min(durations)


def test_there_is_no_smooth_motion_that_takes_longer_than_an_hour() -> None:
    path = np.array([[0.0, 0.0], [0.5, 0.3], [1.0, 0.5]])
    assert timed_smoothly(path, scaled(LIMITS, 1e-6), FREE, Margins()) is None


def test_the_arm_stops_at_a_corner() -> None:
    legs = [np.linspace([0.0, 0.0], [0.5, 0.0], 6), np.linspace([0.5, 0.1], [0.5, 0.5], 5)]
    motion = timed_smoothly(np.concatenate(legs), LIMITS, FREE, Margins())
    assert motion is not None
    at_corner = np.linalg.norm(motion.positions - [0.5, 0.0], axis=1).argmin()
    assert (
        motion.positions[at_corner] == pytest.approx([0.5, 0.0]) and np.abs(motion.velocities[at_corner]).max() == 0.0
    )


def test_a_spline_goes_through_its_points() -> None:
    points = np.array([[0.0, 0.0], [0.3, 0.1], [0.5, 0.4], [0.6, 0.9]])
    spline = Spline.through(points)
    assert spline.at(spline.lengths)[0] == pytest.approx(points)
    middle = spline.lengths[1:-1]
    assert spline.at(middle - 1e-9)[1] == pytest.approx(spline.at(middle + 1e-9)[1], abs=1e-6)


def test_a_path_that_touches_something_has_no_trajectory() -> None:
    assert (
        timed_smoothly(np.array([[0.2, 0.0], [0.8, 0.0], [1.4, 0.0]]), LIMITS, Collisions(ARM, Scene()), Margins())
        is None
    )
