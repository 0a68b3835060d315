"""Processing of a path that was recorded by hand, and its speed."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.teach.hand_path import GRID_S, TOLERANCE, HandPath, inside, movement, outside, path_of, tolerances
from controller.teach.slowing import LEAST, SHARE, goal_points, slowed
from controller.trajectory.goal import STANDS_STILL
from hal.types import FloatArray, JointLimits

LIMITS = (JointLimits(-2.0, 2.0, 3.0, 12.0, 120.0), JointLimits(0.0, 0.05, 0.1, 0.4, 4.0))
RANGES = np.array([4.0, 0.05])

waves = st.tuples(st.floats(0.0, 0.4), st.floats(0.0, 0.4), st.floats(0.1, 2.0), st.floats(0.0, 6.0))


def shown(wave: tuple[float, float, float, float], seconds: float = 4.0) -> tuple[FloatArray, FloatArray]:
    """Return times (k,) and positions (k, 2) of a hand-guided motion from rest to rest, as shares of the joint
    ranges."""
    size, other, hz, phase = wave
    times_s = np.arange(0.0, seconds + 1e-9, GRID_S)
    rests = np.sin(math.pi * times_s / seconds) ** 2
    first = size * rests * np.sin(math.tau * hz * times_s + phase)
    second = 0.5 + other * rests * np.cos(math.tau * 0.7 * hz * times_s)
    return times_s, np.stack([first * RANGES[0], second * RANGES[1]], axis=1)


@given(waves)
def test_thinned_path_equals_the_full_path_at_every_sample(wave: tuple[float, float, float, float]) -> None:
    times_s, position = shown(wave)
    whole = HandPath(times_s, position, np.gradient(position, GRID_S, axis=0))
    thin = whole.thinned(tolerances(LIMITS))
    assert (np.abs(thin.at(times_s)[0] - position) <= TOLERANCE * RANGES + 1e-12).all()
    assert np.isin(thin.times_s, times_s).all() and (thin.times_s[0], thin.times_s[-1]) == (0.0, times_s[-1])
    again = thin.thinned(tolerances(LIMITS))
    assert len(again.times_s) <= len(thin.times_s) <= len(times_s)


@given(waves, st.floats(0.05, 1.0))
def test_slowed_path_respects_velocity_limits_and_keeps_its_shape(
    wave: tuple[float, float, float, float], speed: float
) -> None:
    path = path_of(*shown(wave), LIMITS)
    if path is None:
        return
    slow = slowed(path, LIMITS, speed)
    velocity = np.diff(slow.position, axis=0) / np.diff(slow.times_s)[:, None]
    fastest = np.array([limit.velocity for limit in LIMITS])
    assert (np.abs(slow.velocity) <= SHARE * fastest + 1e-9).all() and (np.abs(velocity) <= fastest).all()
    assert slow.duration_s >= path.duration_s / speed - 1e-9
    even_s = np.linspace(0.0, path.duration_s, len(slow.times_s))
    assert np.allclose(slow.position, path.at(even_s)[0], atol=1e-9)


@given(waves)
def test_goal_points_are_within_the_limits_and_dense_enough_for_the_planner(
    wave: tuple[float, float, float, float],
) -> None:
    path = path_of(*shown(wave), LIMITS)
    if path is None:
        return
    points = goal_points(slowed(path, LIMITS, 1.0), LIMITS)
    assert len(points) >= LEAST - 1
    assert not outside(np.array([point.positions for point in points]), LIMITS).any()
    assert points[-1].velocities == pytest.approx((0.0, 0.0), abs=STANDS_STILL / 10.0)
    assert all(earlier.time_from_start_s < later.time_from_start_s for earlier, later in pairwise(points))


def test_feasible_path_is_not_slowed_down() -> None:
    times_s, position = shown((0.1, 0.1, 0.3, 0.0))
    path = path_of(times_s, position, LIMITS)
    assert path is not None
    assert slowed(path, LIMITS, 1.0).duration_s == pytest.approx(path.duration_s, abs=1e-9)
    assert slowed(path, LIMITS, 0.5).duration_s == pytest.approx(2.0 * path.duration_s, abs=1e-9)


def test_only_parts_that_are_too_fast_are_slowed_down() -> None:
    times_s = np.arange(0.0, 6.0, GRID_S)
    # The hand moves by 1.5 rad in 0.2 s, but the joint needs half a second
    leap = np.clip((times_s - 3.0) / 0.2, 0.0, 1.0)
    slow = np.sin(times_s) * 0.2
    position = np.stack([slow + 1.5 * leap, np.full_like(times_s, 0.02)], axis=1)
    path = path_of(times_s, position, LIMITS)
    assert path is not None
    longer_s = slowed(path, LIMITS, 1.0).duration_s - path.duration_s
    assert 0.3 < longer_s < 1.5


def test_smoothing_removes_noise_and_keeps_the_amplitude() -> None:
    times_s, still = shown((0.2, 0.0, 0.5, 0.0))
    count = math.tau / 4096
    shaking = 0.01 * np.sin(math.tau * 9.0 * times_s)
    position = still.copy()
    position[:, 0] = np.round((still[:, 0] + shaking) / count) * count
    path = path_of(times_s, position, LIMITS)
    assert path is not None
    begun_s = float(times_s[movement(times_s, position, tolerances(LIMITS, 0.003))][0])
    off = path.at(np.linspace(0.0, path.duration_s, 200))[0] - np.stack(
        [np.interp(begun_s + np.linspace(0.0, path.duration_s, 200), times_s, column) for column in still.T], axis=1
    )
    assert np.abs(off[:, 0]).max() < 0.006, "of 0.01 rad of shaking"
    assert len(path.times_s) < len(times_s) / 3


def test_rest_before_and_after_is_removed_and_rest_alone_is_not_a_path() -> None:
    times_s = np.arange(0.0, 10.0, GRID_S)
    position = np.stack([np.clip(times_s - 4.0, 0.0, 1.0), np.full_like(times_s, 0.02)], axis=1)
    path = path_of(times_s, position, LIMITS)
    assert path is not None and path.duration_s == pytest.approx(1.6, abs=0.1)
    assert path.position[0, 0] == pytest.approx(0.0, abs=0.005) and path.position[-1, 0] == pytest.approx(
        1.0, abs=0.005
    )
    assert path_of(times_s, np.zeros((len(times_s), 2)) + 0.02, LIMITS) is None


def test_uneven_samples_with_a_gap_become_an_even_path() -> None:
    times_s, position = shown((0.2, 0.1, 0.3, 0.0))
    kept = np.ones(len(times_s), dtype=bool)
    kept[80:95] = False
    path, gap = path_of(times_s, position, LIMITS), path_of(times_s[kept], position[kept], LIMITS)
    assert path is not None and gap is not None
    assert gap.duration_s == pytest.approx(path.duration_s, abs=0.05)


def test_positions_beyond_the_limits_are_limited_with_a_warning() -> None:
    position = np.array([[-2.5, 0.02], [0.0, 0.07]])
    assert outside(position, LIMITS) == pytest.approx([0.5, 0.02])
    assert not outside(inside(position, LIMITS), LIMITS).any()


@given(waves)
def test_path_beyond_the_limits_is_played_within_them_between_points_too(
    wave: tuple[float, float, float, float],
) -> None:
    times_s, position = shown(wave)
    path = path_of(times_s, position * np.array([2.0, 1.0]), LIMITS)
    if path is None:
        return
    points = goal_points(slowed(path, LIMITS, 1.0), LIMITS)
    played = HandPath(
        np.array([point.time_from_start_s for point in points]),
        np.array([point.positions for point in points]),
        np.array([point.velocities for point in points]),
    )
    assert not outside(played.sampled(0.001).position, LIMITS).any()
