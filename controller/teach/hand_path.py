"""The path that a hand has shown: freed of its shaking, and thinned to the knots that it needs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hal.types import FloatArray, JointLimits

GRID_S: Final = 0.02
"""The time between two samples of a path that is worked on."""
WINDOW: Final = 15
"""Samples over which a hand's shaking (about 10 Hz) is averaged; a turn within 0.3 s keeps its size."""
ORDER: Final = 3
"""Of the polynomials that take a hand's movement for what is none of them."""
TOLERANCE: Final = 0.001
"""Share of a joint's range by which the thinned path may be beside the smooth one: 0.2 degrees, two encoder counts."""
STIRS: Final = 0.003
"""Share of a joint's range within which a joint counts as standing."""
BEFORE_S: Final = 0.3
"""So much of the standing before the first movement is kept, and behind the last one."""


@dataclass(frozen=True, slots=True)
class HandPath:
    """A path through m knots of n joints, a cubic from each to the next: ``times_s`` (m,) from 0 on, strictly
    increasing; ``position`` and ``velocity`` (m, n) in rad or m and per second.
    """

    times_s: FloatArray
    position: FloatArray
    velocity: FloatArray

    @property
    def duration_s(self) -> float:
        """From the first knot to the last."""
        return float(self.times_s[-1])

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities (k, n) at these times (k,), which lie within the path."""
        index = self._knots_before(times_s)
        return _cubic(self, index, index + 1, times_s)

    def knot_before(self, time_s: float) -> int:
        """The number of the knot from which the cubic at this time begins."""
        return int(self._knots_before(np.array([time_s]))[0])

    def _knots_before(self, times_s: FloatArray) -> np.ndarray:
        return np.clip(np.searchsorted(self.times_s, times_s, side="right") - 1, 0, len(self.times_s) - 2)

    def sampled(self, step_s: float = GRID_S) -> Self:
        """The same path with a knot about every ``step_s``."""
        times_s = np.linspace(0.0, self.duration_s, max(2, round(self.duration_s / step_s) + 1))
        return type(self)(times_s, *self.at(times_s))

    def divided(self, least: int) -> Self:
        """The same path with so many knots or more: those that it has, and as many between any two."""
        parts = math.ceil((least - 1) / (len(self.times_s) - 1))
        places = np.linspace(0.0, len(self.times_s) - 1.0, parts * (len(self.times_s) - 1) + 1)
        times_s = np.interp(places, np.arange(len(self.times_s)), self.times_s)
        return type(self)(times_s, *self.at(times_s))

    def thinned(self, tolerance: FloatArray) -> Self:
        """The path without the knots whose places it keeps anyway, but for ``tolerance`` (n,): a Douglas-Peucker with
        cubics for chords."""
        kept = {0, len(self.times_s) - 1}
        open_spans = [(0, len(self.times_s) - 1)]
        while open_spans:
            first, last = open_spans.pop()
            between = np.arange(first + 1, last)
            if not len(between):
                continue
            found, _ = _cubic(self, np.full(len(between), first), np.full(len(between), last), self.times_s[between])
            off = (np.abs(found - self.position[between]) / tolerance).max(axis=1)
            if off.max() > 1.0:
                worst = first + 1 + int(np.argmax(off))
                kept.add(worst)
                open_spans += [(first, worst), (worst, last)]
        rows = sorted(kept)
        return type(self)(self.times_s[rows], self.position[rows], self.velocity[rows])


def _cubic(path: HandPath, first: np.ndarray, last: np.ndarray, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position and velocity (k, n) at ``times_s`` (k,) on the cubics from the knots ``first`` (k,) to ``last`` (k,)."""
    span_s = (path.times_s[last] - path.times_s[first])[:, None]
    u = (times_s - path.times_s[first])[:, None] / span_s
    start, way = path.position[first], path.position[last] - path.position[first]
    out, back = path.velocity[first] * span_s, path.velocity[last] * span_s
    a, b = 3.0 * way - 2.0 * out - back, out + back - 2.0 * way
    position: FloatArray = start + u * (out + u * (a + u * b))
    velocity: FloatArray = (out + u * (2.0 * a + 3.0 * u * b)) / span_s
    return position, velocity


def tolerances(limits: Sequence[JointLimits], share: float = TOLERANCE) -> FloatArray:
    """A share of each joint's range (n,), rad or m."""
    return share * np.array([limit.upper - limit.lower for limit in limits])


def path_of(times_s: FloatArray, position: FloatArray, limits: Sequence[JointLimits]) -> HandPath | None:
    """The path of samples: ``position`` (k, n) at the times (k,), which may be uneven. None where nothing moved.

    The standing before and behind is cut off. What is outside the limits is taken to them.
    """
    moved = movement(times_s, position, tolerances(limits, STIRS))
    if moved is None:
        return None
    return kept_inside(smoothed(times_s[moved], position[moved]), limits).thinned(tolerances(limits))


def kept_inside(path: HandPath, limits: Sequence[JointLimits]) -> HandPath:
    """The path taken to the limits. Beside them it is slow enough that its cubics do not swing beyond: three times the
    slower of the slopes around a knot (Fritsch and Carlson)."""
    position = inside(path.position, limits)
    slopes = np.pad(np.diff(position, axis=0) / np.diff(path.times_s)[:, None], ((1, 1), (0, 0)))
    before, behind = slopes[:-1], slopes[1:]
    steepest = np.where(before * behind > 0.0, 3.0 * np.minimum(np.abs(before), np.abs(behind)), 0.0)
    taken = np.pad(position != path.position, ((1, 1), (0, 0)))
    beside = taken[:-2] | taken[1:-1] | taken[2:]
    return HandPath(
        path.times_s, position, np.where(beside, np.clip(path.velocity, -steepest, steepest), path.velocity)
    )


def movement(times_s: FloatArray, position: FloatArray, stirs: FloatArray) -> slice | None:
    """The samples from the first that moves by more than ``stirs`` (n,) to the last, and ``BEFORE_S`` around."""
    left = np.flatnonzero((np.abs(position - position[0]) > stirs).any(axis=1))
    arrives = np.flatnonzero((np.abs(position - position[-1]) > stirs).any(axis=1))
    if not len(left) and not len(arrives):
        return None
    begin_s = times_s[int(left[0]) if len(left) else 0] - BEFORE_S
    end_s = times_s[int(arrives[-1]) if len(arrives) else -1] + BEFORE_S
    return slice(int(np.searchsorted(times_s, begin_s)), int(np.searchsorted(times_s, end_s, side="right")))


def smoothed(times_s: FloatArray, position: FloatArray) -> HandPath:
    """The samples at even times from 0 on, each the middle of the cubic that fits its neighbours best (Savitzky and
    Golay); at rest at both ends."""
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
    """Positions (k, n) taken to the limits where they are beyond; a thinned path's tolerance within them, so that it
    does not swing beyond either."""
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    margin = tolerances(limits)
    taken: FloatArray = np.clip(position, lower + margin, upper - margin)
    return taken


def outside(position: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """How far positions (k, n) go beyond the limits at the most (n,), rad or m; 0 where they do not."""
    most: FloatArray = excess(position, limits).max(axis=0)
    return most


def excess(position: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """How far each of the positions (k, n) is beyond the limits, rad or m; 0 where it is not."""
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    beyond: FloatArray = np.maximum(np.maximum(lower - position, position - upper), 0.0)
    return beyond
