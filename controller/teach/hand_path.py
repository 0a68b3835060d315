"""Convert a recorded hand motion to a path: remove hand tremor and keep only the necessary knots."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hal.types import FloatArray, JointLimits

GRID_S: Final = 0.02
"""Time between two samples of a path during processing, in seconds."""
WINDOW: Final = 15
"""Number of samples over which hand tremor (about 10 Hz) is averaged. A reversal within 0.3 s keeps its amplitude.
"""
ORDER: Final = 3
"""Order of the polynomials that approximate the hand motion."""
TOLERANCE: Final = 0.001
"""Maximum deviation of the thinned path from the smooth path, as a fraction of a joint's range. This deviation
corresponds to 0.2 degrees, or two encoder counts.
"""
STIRS: Final = 0.003
"""Maximum motion of a joint that counts as at rest, as a fraction of its range."""
BEFORE_S: Final = 0.3
"""Time at rest to keep before the first and after the last motion, in seconds."""


@dataclass(frozen=True, slots=True)
class HandPath:
    """A path through m knots for n joints, with a cubic between consecutive knots.

    ``times_s`` (m,) starts at 0 and is strictly increasing. ``position`` (m, n) is in rad or m, and ``velocity`` (m, n)
    is in rad/s or m/s.
    """

    times_s: FloatArray
    position: FloatArray
    velocity: FloatArray

    @property
    def duration_s(self) -> float:
        """Time from the first to the last knot, in seconds."""
        return float(self.times_s[-1])

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities (k, n) at times (k,) within the path."""
        index = self._knots_before(times_s)
        return _cubic(self, index, index + 1, times_s)

    def knot_before(self, time_s: float) -> int:
        """Return the index of the knot at which the cubic that contains this time starts."""
        return int(self._knots_before(np.array([time_s]))[0])

    def _knots_before(self, times_s: FloatArray) -> np.ndarray:
        return np.clip(np.searchsorted(self.times_s, times_s, side="right") - 1, 0, len(self.times_s) - 2)

    def sampled(self, step_s: float = GRID_S) -> Self:
        """Return the same path with knots approximately ``step_s`` apart."""
        times_s = np.linspace(0.0, self.duration_s, max(2, round(self.duration_s / step_s) + 1))
        return type(self)(times_s, *self.at(times_s))

    def divided(self, least: int) -> Self:
        """Return the same path with at least ``least`` knots.

        Each segment between two knots is divided by the same number of new knots.
        """
        parts = math.ceil((least - 1) / (len(self.times_s) - 1))
        places = np.linspace(0.0, len(self.times_s) - 1.0, parts * (len(self.times_s) - 1) + 1)
        times_s = np.interp(places, np.arange(len(self.times_s)), self.times_s)
        return type(self)(times_s, *self.at(times_s))

    def thinned(self, tolerance: FloatArray) -> Self:
        """Return the path without unnecessary knots. The new path passes within ``tolerance`` (n,) of each removed
        knot, and leaves the range of the knots by ``tolerance`` at most.

        This is the Douglas-Peucker algorithm with cubics instead of straight chords.
        """
        kept = {0, len(self.times_s) - 1}
        open_spans = [(0, len(self.times_s) - 1)]
        while open_spans:
            first, last = open_spans.pop()
            between = np.arange(first + 1, last)
            if not len(between):
                continue
            found, _ = _cubic(self, np.full(len(between), first), np.full(len(between), last), self.times_s[between])
            off = (np.abs(found - self.position[between]) / tolerance).max(axis=1)
            if off.max() > 1.0 or (_excursion(self, first, last) > tolerance).any():
                worst = first + 1 + int(np.argmax(off))
                kept.add(worst)
                open_spans += [(first, worst), (worst, last)]
        rows = sorted(kept)
        return type(self)(self.times_s[rows], self.position[rows], self.velocity[rows])


def _cubic(path: HandPath, first: np.ndarray, last: np.ndarray, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities (k, n) at times (k,) on the cubics from knots ``first`` to ``last`` (k,)."""
    span_s = (path.times_s[last] - path.times_s[first])[:, None]
    u = (times_s - path.times_s[first])[:, None] / span_s
    start = path.position[first]
    out, a, b = _coefficients(path, first, last, span_s)
    position: FloatArray = start + u * (out + u * (a + u * b))
    velocity: FloatArray = (out + u * (2.0 * a + 3.0 * u * b)) / span_s
    return position, velocity


def _coefficients(path: HandPath, first: Any, last: Any, span_s: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficients of u, u^2 and u^3 in the cubics from knots ``first`` to ``last``, for u from 0 to 1."""
    way = path.position[last] - path.position[first]
    out, back = path.velocity[first] * span_s, path.velocity[last] * span_s
    return out, 3.0 * way - 2.0 * out - back, out + back - 2.0 * way


def _excursion(path: HandPath, first: int, last: int) -> FloatArray:
    """Return the distance (n,) by which the cubic from knot ``first`` to knot ``last`` leaves the range of the knots
    from ``first`` to ``last``. The distance is negative if the cubic stays within the range."""
    out, a, b = _coefficients(path, first, last, path.times_s[last] - path.times_s[first])
    # The speed out + 2 a u + 3 b u^2 is zero at the extremes of the cubic.
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -a - np.copysign(np.sqrt(a * a - 3.0 * b * out), a)
        u = np.stack([q / (3.0 * b), out / q])
    u = np.clip(np.nan_to_num(u, nan=0.0, posinf=0.0, neginf=0.0), 0.0, 1.0)
    extremes = path.position[first] + u * (out + u * (a + u * b))
    knots = path.position[first : last + 1]
    distance: FloatArray = np.maximum(
        knots.min(axis=0) - extremes.min(axis=0), extremes.max(axis=0) - knots.max(axis=0)
    )
    return distance


def tolerances(limits: Sequence[JointLimits], share: float = TOLERANCE) -> FloatArray:
    """Return the given fraction of each joint's range (n,), in rad or m."""
    return share * np.array([limit.upper - limit.lower for limit in limits])


def path_of(times_s: FloatArray, position: FloatArray, limits: Sequence[JointLimits]) -> HandPath | None:
    """Return the path of a recording, or None if no joint moved.

    Rest periods before and after the motion are removed, and positions outside the limits are clipped.

    Args:
        times_s: Times of the k samples, which need not be evenly spaced.
        position: Recorded positions, shape (k, n).
        limits: Limits of the n joints.
    """
    moved = movement(times_s, position, tolerances(limits, STIRS))
    if moved is None:
        return None
    return kept_inside(smoothed(times_s[moved], position[moved]), limits).thinned(tolerances(limits))


def kept_inside(path: HandPath, limits: Sequence[JointLimits]) -> HandPath:
    """Clip a path to the limits.

    Next to clipped knots, the velocity is limited to three times the smaller slope at the knot (Fritsch and Carlson),
    so that the cubics do not overshoot the limits.
    """
    position = inside(path.position, limits)
    slopes = np.pad(np.diff(position, axis=0) / np.diff(path.times_s)[:, None], ((1, 1), (0, 0)))
    before, after = slopes[:-1], slopes[1:]
    steepest = np.where(before * after > 0.0, 3.0 * np.minimum(np.abs(before), np.abs(after)), 0.0)
    clipped = np.pad(position != path.position, ((1, 1), (0, 0)))
    nearby = clipped[:-2] | clipped[1:-1] | clipped[2:]
    return HandPath(
        path.times_s, position, np.where(nearby, np.clip(path.velocity, -steepest, steepest), path.velocity)
    )


def movement(times_s: FloatArray, position: FloatArray, stirs: FloatArray) -> slice | None:
    """Return the samples from the first to the last motion larger than ``stirs`` (n,), plus ``BEFORE_S`` on each side.

    Returns None if no joint moved.
    """
    left = np.flatnonzero((np.abs(position - position[0]) > stirs).any(axis=1))
    arrives = np.flatnonzero((np.abs(position - position[-1]) > stirs).any(axis=1))
    if not len(left) and not len(arrives):
        return None
    begin_s = times_s[int(left[0]) if len(left) else 0] - BEFORE_S
    end_s = times_s[int(arrives[-1]) if len(arrives) else -1] + BEFORE_S
    return slice(int(np.searchsorted(times_s, begin_s)), int(np.searchsorted(times_s, end_s, side="right")))


def smoothed(times_s: FloatArray, position: FloatArray) -> HandPath:
    """Resample at evenly spaced times starting at 0 and smooth with a Savitzky-Golay filter. The path is at rest at
    both ends."""
    since_s = times_s - times_s[0]
    even_s = np.linspace(0.0, since_s[-1], max(2, round(since_s[-1] / GRID_S) + 1))
    even = np.stack([np.interp(even_s, since_s, column) for column in position.T], axis=1)
    count = min(WINDOW, len(even) - 1 + len(even) % 2)
    middle, order = count // 2, min(ORDER, count - 1)
    fit = np.linalg.pinv(np.vander(np.arange(-middle, middle + 1), order + 1, increasing=True))
    fitted = sliding_window_view(even, count, axis=0) @ fit.T  # (windows, n, order + 1)
    place = np.arange(len(even))
    window = np.clip(place - middle, 0, len(fitted) - 1)
    powers = np.vander(place - middle - window, order + 1, increasing=True)
    slopes = np.hstack((np.zeros((len(even), 1)), powers[:, :-1] * np.arange(1, order + 1)))
    velocity = np.einsum("knp,kp->kn", fitted[window], slopes) / (even_s[1] - even_s[0])
    velocity[[0, -1]] = 0.0
    return HandPath(even_s, np.einsum("knp,kp->kn", fitted[window], powers), velocity)


def inside(position: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """Clip positions (k, n) to the limits, with a margin so that a thinned path also stays within the limits."""
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    margin = tolerances(limits)
    clipped: FloatArray = np.clip(position, lower + margin, upper - margin)
    return clipped


def outside(position: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """Return the maximum distance (n,) by which positions (k, n) exceed the limits, in rad or m; 0 if none does."""
    most: FloatArray = excess(position, limits).max(axis=0)
    return most


def excess(position: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """Return the distance (k, n) by which each position exceeds the limits, in rad or m.

    The distance is 0 for positions within the limits.
    """
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    beyond: FloatArray = np.maximum(np.maximum(lower - position, position - upper), 0.0)
    return beyond
