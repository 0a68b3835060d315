"""Smooth a spline through many waypoints to limit its jerk.

The spline is averaged over two time windows. An average never exceeds the range of the averaged values, so the path
stays within the limits of the spline. The first window turns steps of velocity into ramps, and the second window turns
steps of acceleration into ramps. The path ends later by the combined length of both windows (a few tenths of a second)
and cuts corners by acceleration * window² / 24. With many closely spaced points, ruckig would have to reach each of
them within the jerk limit, which can take many times as long.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.motion import Kinematics
from controller.trajectory.splines import SplinePath, spline
from controller.trajectory.waypoints import Bounds, Waypoints, estimated_velocities
from hal.types import FloatArray, JointLimits

GRAIN_S: Final = 0.005
"""Step of the time grid, in seconds. Windows are multiples of this step. Limits are checked at the grid points."""
MARGIN: Final = 0.95
"""Fraction of a limit that may be used at the grid points, because values between them can be higher."""


@dataclass(frozen=True, slots=True)
class SmoothPath:
    """Average of a spline over two time windows.

    The positions of ``spline`` are relative to ``origin`` (n,), for accuracy at large positions. ``integrals`` (k, 2,
    n) holds the first and second integrals of the spline from its start to the start of each segment.
    """

    spline: SplinePath
    origin: FloatArray
    integrals: FloatArray
    windows_s: tuple[float, float]

    @property
    def asked_s(self) -> float:
        """Requested duration of the spline, in seconds."""
        return self.spline.asked_s

    @property
    def duration_s(self) -> float:
        """Duration of the spline plus both windows, in seconds."""
        return self.spline.duration_s + sum(self.windows_s)

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start."""
        if time_s > self.duration_s:
            return Kinematics.at_rest(self.origin + self._moments(self.spline.duration_s)[2])
        first, second = self.windows_s
        at = [self._moments(t) for t in (time_s, time_s - first, time_s - second, time_s - first - second)]
        position, velocity, acceleration = (at[0] - at[1] - at[2] + at[3]) / (first * second)
        return Kinematics(self.origin + position, velocity, acceleration)

    def _moments(self, time_s: float) -> FloatArray:
        """Return the second integral, the first integral and the position itself, shape (3, n)."""
        spline = self.spline
        inside_s = min(max(time_s, 0.0), spline.duration_s)
        index = max(bisect_right(spline.starts_s, inside_s) - 1, 0)
        t = inside_s - spline.starts_s[index]
        moments: FloatArray = _powers(t) @ spline.coefficients[index]
        once, twice = self.integrals[index]
        moments[1] += once
        moments[0] += twice + once * t
        after_s = time_s - inside_s
        if after_s > 0.0:  # The spline is at rest at its end. Before its start, all moments are 0.
            moments[0] += moments[1] * after_s + moments[2] * (after_s**2 / 2.0)
            moments[1] += moments[2] * after_s
        return moments


def _powers(t: float) -> FloatArray:
    """Return the factors of a polynomial's coefficients, with rows for the second integral, the first integral and the
    value."""
    t2, t3, t4, t5 = t * t, t**3, t**4, t**5
    t6, t7 = t3 * t3, t3 * t4
    return np.array(
        (
            (t2 / 2.0, t3 / 6.0, t4 / 12.0, t5 / 20.0, t6 / 30.0, t7 / 42.0),
            (t, t2 / 2.0, t3 / 3.0, t4 / 4.0, t5 / 5.0, t6 / 6.0),
            (1.0, t, t2, t3, t4, t5),
        )
    )


def smooth_path(
    start: Kinematics, waypoints: Waypoints, limits: Sequence[JointLimits], names: Sequence[str] = ()
) -> SmoothPath:
    """Plan a smooth path that starts at rest at ``start`` and passes through all points. Raises MotionError."""
    bounds = Bounds.of(limits)
    still = Kinematics.at_rest(start.position)
    positions = np.vstack((start.position, waypoints.position))
    spans_s = np.maximum(np.diff(waypoints.times_s, prepend=0.0), 1e-6)
    estimate = np.clip(estimated_velocities(positions, spans_s), -bounds.velocity, bounds.velocity)
    given = waypoints.has_velocity[:, None]
    everywhere = np.ones(len(spans_s), dtype=np.bool_)
    cubic = replace(
        waypoints,
        velocity=np.where(given, waypoints.velocity, estimate),
        has_velocity=everywhere,
        has_acceleration=~everywhere,
    )
    path = spline(still, cubic, limits, names)
    coefficients = path.coefficients.copy()
    coefficients[:, 0] -= start.position
    path = replace(path, coefficients=coefficients)
    return SmoothPath(path, start.position, _integrals(path), _windows(path, bounds))


def _integrals(path: SplinePath) -> FloatArray:
    """Return both integrals at the start of each segment, shape (k, 2, n)."""
    count, _, joints = path.coefficients.shape
    found = np.zeros((count, 2, joints))
    for index in range(count - 1):
        t = path.starts_s[index + 1] - path.starts_s[index]
        twice, once, _ = _powers(t) @ path.coefficients[index]
        found[index + 1] = found[index, 0] + once, found[index, 1] + found[index, 0] * t + twice
    return found


def _windows(path: SplinePath, bounds: Bounds) -> tuple[float, float]:
    velocity = _velocities(path)
    first = _window(velocity, bounds.acceleration)
    acceleration = _changes(velocity, first) / (first * GRAIN_S)
    second = _window(acceleration, bounds.jerk)
    return first * GRAIN_S, second * GRAIN_S


def _velocities(path: SplinePath) -> FloatArray:
    """Return the velocities at all grid points of the path, shape (count, n)."""
    times = np.arange(0.0, path.duration_s, GRAIN_S)
    index = np.searchsorted(path.starts_s, times, side="right") - 1
    t = (times - np.array(path.starts_s)[index])[:, None]
    c = path.coefficients[index]
    found: FloatArray = c[:, 1] + t * (2.0 * c[:, 2] + t * (3.0 * c[:, 3] + t * (4.0 * c[:, 4] + t * 5.0 * c[:, 5])))
    return found


def _changes(values: FloatArray, grains: int) -> FloatArray:
    """Return the changes of ``values`` within a window of ``grains`` grid steps. Values outside the path are 0."""
    still = np.zeros((grains, values.shape[1]))
    return np.vstack((values, still)) - np.vstack((still, values))


def _window(values: FloatArray, rate: FloatArray) -> int:
    """Return the shortest window, in grid steps, in which ``values`` (count, n) change by at most ``rate`` (n,)."""
    largest = 2.0 * np.abs(values).max(axis=0, initial=0.0)
    longest = int(np.ceil((largest / rate).max() / (MARGIN * GRAIN_S))) + 1
    for grains in range(1, longest):
        if (np.abs(_changes(values, grains)) <= MARGIN * rate * grains * GRAIN_S).all():
            return grains
    return longest
