"""Compute the timing of a smooth path with many points, such as a straight tool motion.

A cubic spline passes through the points, and ruckig moves along the spline within limits that hold at every point of
the spline. The arm stops at each corner of the path.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from ruckig import Trajectory

from hal.types import FloatArray, JointLimits
from planning.collision import Collisions, Margins
from planning.paths.blends import SAG, distinct
from planning.paths.margins import PathMargins
from planning.paths.timing import LONGEST_S, PERIOD_S, Caps, TimedPath, ramp_of

CORNER_RAD: Final = 0.3
"""Minimum angle between two edges in joint space at which a point is considered a corner."""
SHARES: Final = (0.5, 1.0 / 3.0)
"""Maximum size of each acceleration term and of each jerk term, as a fraction of the limit. The acceleration has two
terms, and the jerk has three."""
TINY: Final = 1e-9
"""Lower bound for a derivative, so that a joint at rest does not limit the motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Spline:
    """Cubic spline through points, as a function of the length along the edges.

    The first and last segments are parabolas.
    """

    lengths: FloatArray
    """Length at each point (m,), in rad."""
    points: FloatArray
    """Points (m, n), in rad or m."""
    bends: FloatArray
    """Second derivatives at the points (m, n)."""

    @classmethod
    def through(cls, points: FloatArray) -> "Spline":
        """Return the spline through at least two distinct points (m, n)."""
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        slopes = np.diff(points, axis=0) / steps[:, None]
        bends = np.zeros_like(points)
        if len(points) > 2:
            bends[1:-1] = _tridiagonal(steps, 6.0 * np.diff(slopes, axis=0))
            bends[0], bends[-1] = bends[1], bends[-2]
        return cls(np.concatenate(([0.0], np.cumsum(steps))), points, bends)

    def at(self, lengths: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the positions and their first and second derivatives (k, n) at the lengths (k,)."""
        index = np.clip(np.searchsorted(self.lengths, lengths, "right") - 1, 0, len(self.points) - 2)
        step = (self.lengths[index + 1] - self.lengths[index])[:, None]
        after = lengths[:, None] - self.lengths[index][:, None]
        before = step - after
        one, other, low, high = self.points[index], self.points[index + 1], self.bends[index], self.bends[index + 1]
        positions = (
            (low * before**3 + high * after**3) / (6.0 * step)
            + (one / step - low * step / 6.0) * before
            + (other / step - high * step / 6.0) * after
        )
        first = (high * after**2 - low * before**2) / (2.0 * step) + (other - one) / step - (high - low) * step / 6.0
        return positions, first, (low * before + high * after) / step

    def largest(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the maximum first, second and third derivatives of each joint (n,)."""
        steps = np.diff(self.lengths)[:, None]
        places = np.concatenate((self.lengths, self.lengths[:-1] + steps[:, 0] / 2.0))
        slopes = np.abs(self.at(places)[1]).max(axis=0) + np.abs(np.diff(self.bends, axis=0) * steps).max(axis=0) / 8.0
        thirds = np.abs(np.diff(self.bends, axis=0) / steps).max(axis=0)
        return np.maximum(slopes, TINY), np.maximum(np.abs(self.bends).max(axis=0), TINY), np.maximum(thirds, TINY)


def timed_smoothly(
    path: FloatArray, limits: Sequence[JointLimits], collisions: Collisions, margins: Margins
) -> TimedPath | None:
    """Return a trajectory along splines through the points of a path, or None if the trajectory comes too close to an
    obstacle or takes longer than LONGEST_S.

    Args:
        path: Points (m, n), in rad or m. The edges between the points are free.
        limits: Velocity, acceleration and jerk limits of the joints (n).
        collisions: Checks of the arm in the scene.
        margins: Padding and tolerance of the path.
    """
    path = distinct(np.asarray(path, dtype=float))
    if len(path) < 2:
        return None
    corners = _corners(path)
    splines = [Spline.through(path[first : last + 1]) for first, last in itertools.pairwise(corners)]
    ramps = [ramp_of(0.0, 0.0, float(spline.lengths[-1]), _caps(spline, limits)) for spline in splines]
    if sum(ramp.duration for ramp in ramps) > LONGEST_S:
        return None
    parts = [_along(spline, ramp) for spline, ramp in zip(splines, ramps, strict=True)]
    trajectory = _joined([part for part, _ in parts])
    sags_m = np.concatenate([[collisions.deviation_m(sag) for sag in sags] for _, sags in parts])
    contact = PathMargins(margins).for_parts().contact(collisions, list(trajectory.positions), sags_m)
    return trajectory if contact is None else None


def _along(spline: Spline, ramp: Trajectory) -> tuple[TimedPath, FloatArray]:
    """Return a trajectory along a spline that starts and ends at rest, and the maximum distance of the spline from each
    chord (k - 1, n)."""
    times_s = np.append(np.arange(0.0, ramp.duration - PERIOD_S / 2.0, PERIOD_S), ramp.duration)
    along, speeds, gains = np.array([[float(np.ravel(value)[0]) for value in ramp.at_time(at_s)] for at_s in times_s]).T
    positions, first, second = spline.at(np.clip(along, 0.0, spline.lengths[-1]))
    positions[0], positions[-1], speeds[0], speeds[-1] = spline.points[0], spline.points[-1], 0.0, 0.0
    velocities = first * speeds[:, None]
    accelerations = first * gains[:, None] + second * speeds[:, None] ** 2
    sags = SAG * np.diff(along)[:, None] ** 2 * spline.largest()[1]
    return TimedPath(times_s, positions, velocities, accelerations), sags


def _caps(spline: Spline, limits: Sequence[JointLimits]) -> Caps:
    """Return limits for the motion along a spline that keep every joint within its own limits.

    The acceleration of a joint is q' s'' + q'' s'², and its jerk is q' s''' + 3 q'' s' s'' + q''' s'³.
    """
    slopes, bends, thirds = spline.largest()
    velocity, acceleration, jerk = np.array([[one.velocity, one.acceleration, one.jerk] for one in limits]).T
    half, third = SHARES
    speed = min(
        float((velocity / slopes).min()),
        float(np.sqrt(half * acceleration / bends).min()),
        float(np.cbrt(third * jerk / thirds).min()),
    )
    gain = min(float((half * acceleration / slopes).min()), float((third * jerk / (3.0 * bends * speed)).min()))
    return Caps(speed, gain, float((third * jerk / slopes).min()))


def _corners(path: FloatArray) -> list[int]:
    """Return the indices of the corners of a path, including the two ends."""
    edges = np.diff(path, axis=0)
    directions = edges / np.linalg.norm(edges, axis=1)[:, None]
    cosines = (directions[1:] * directions[:-1]).sum(axis=1)
    return [0, *(np.flatnonzero(cosines < np.cos(CORNER_RAD)) + 1).tolist(), len(path) - 1]


def _joined(parts: Sequence[TimedPath]) -> TimedPath:
    """Join trajectories, each of which begins where the previous trajectory ends."""
    times_s, rows = [parts[0].times_s], [parts[0]]
    for part in parts[1:]:
        times_s.append(part.times_s[1:] + times_s[-1][-1])
        rows.append(TimedPath(part.times_s[1:], part.positions[1:], part.velocities[1:], part.accelerations[1:]))
    return TimedPath(
        np.concatenate(times_s),
        np.concatenate([row.positions for row in rows]),
        np.concatenate([row.velocities for row in rows]),
        np.concatenate([row.accelerations for row in rows]),
    )


def _tridiagonal(steps: FloatArray, right: FloatArray) -> FloatArray:
    """Solve for the second derivatives at the inner points (m - 2, n) with the Thomas algorithm."""
    middle, off = 2.0 * (steps[:-1] + steps[1:]), steps[1:-1]
    middle, right = middle.copy(), right.copy()
    # The second derivative is constant before the first inner point and after the last inner point.
    middle[0] += steps[0]
    middle[-1] += steps[-1]
    for row in range(1, len(middle)):
        factor = off[row - 1] / middle[row - 1]
        middle[row] -= factor * off[row - 1]
        right[row] -= factor * right[row - 1]
    found = np.empty_like(right)
    found[-1] = right[-1] / middle[-1]
    for row in range(len(middle) - 2, -1, -1):
        found[row] = (right[row] - off[row] * found[row + 1]) / middle[row]
    return found
