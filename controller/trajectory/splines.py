"""Plan splines: paths with one polynomial per segment, as in ros2_control. Units are rad (m) and seconds."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import Kinematics, MotionError, swing_limits
from controller.trajectory.waypoints import BoolArray, Waypoints
from hal.types import FloatArray, JointLimits, beyond_range

ATTEMPTS: Final = 20
"""Maximum number of attempts to give segments more time before the goal is rejected."""
SAMPLES: Final = 33
"""Number of instants at which the velocity and position of a segment are compared with the limits."""
SLACK: Final = 2e-3
"""Fraction by which a curve may exceed a limit between two samples."""
_ROUNDING: Final = 1e-6


@dataclass(frozen=True, slots=True)
class SplinePath:
    """Spline of k segments for n joints.

    ``coefficients`` (k, 6, n) belong to the powers of the time since the segment's start in ``starts_s``, lowest power
    first.
    """

    starts_s: tuple[float, ...]
    coefficients: FloatArray
    duration_s: float
    asked_s: float

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics ``time_s`` after the start; after the end, the joints are at rest."""
        inside_s = min(max(time_s, 0.0), self.duration_s)
        index = max(bisect_right(self.starts_s, inside_s) - 1, 0)
        t = inside_s - self.starts_s[index]
        t2, t3, t4 = t * t, t**3, t**4
        powers = np.array(
            (
                (1.0, t, t2, t3, t4, t4 * t),
                (0.0, 1.0, 2.0 * t, 3.0 * t2, 4.0 * t3, 5.0 * t4),
                (0.0, 0.0, 2.0, 6.0 * t, 12.0 * t2, 20.0 * t3),
            )
        )
        position, velocity, acceleration = powers @ self.coefficients[index]
        if time_s > self.duration_s:
            return Kinematics.at_rest(position)
        return Kinematics(position, velocity, acceleration)


def spline(
    start: Kinematics, waypoints: Waypoints, limits: Sequence[JointLimits], names: Sequence[str] = ()
) -> SplinePath:
    """Plan a spline from ``start`` through all points.

    A segment is quintic if accelerations are given at both ends, cubic if velocities are given at both ends, and
    otherwise linear. Segments that would exceed the velocity limits get more time, and the velocities at their ends are
    reduced. Raises MotionError if a segment would still leave the position limits.
    """
    positions = np.vstack((start.position, waypoints.position))
    asked_s = np.maximum(np.diff(waypoints.times_s, prepend=0.0), 0.0)
    distances = np.abs(np.diff(positions, axis=0))
    top = np.array([limit.velocity for limit in limits])
    # A segment of zero length still needs a positive duration, because the code divides by it.
    spans_s = np.maximum(np.maximum(asked_s, (distances / top).max(axis=1)), 1e-9)
    smooth = np.append(True, waypoints.has_velocity), np.append(True, waypoints.has_acceleration)
    curved = smooth[0][:-1] & smooth[0][1:]
    for _ in range(ATTEMPTS):
        velocity, acceleration = _slowed(start, waypoints, asked_s, spans_s)
        coefficients = _coefficients(positions, velocity, acceleration, smooth, spans_s)
        sampled, speeds = _sample(coefficients, spans_s)
        excess = (speeds / top).max(axis=1) * np.where(curved, 1.0 + SLACK, 1.0)
        if (excess <= 1.0 + _ROUNDING).all():
            _check_positions(sampled, limits, names)
            starts_s = tuple(np.append(0.0, np.cumsum(spans_s)[:-1]).tolist())
            return SplinePath(starts_s, coefficients, float(spans_s.sum()), max(float(waypoints.times_s[-1]), 0.0))
        spans_s = spans_s * np.maximum(excess, 1.0)
    worst = int(np.argmax(excess))
    raise MotionError(
        f"the motion to point #{worst} is {excess[worst]:.1f} times too fast: start at rest or allow more time"
    )


def _slowed(
    start: Kinematics, waypoints: Waypoints, asked_s: FloatArray, spans_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the velocities and accelerations (m + 1, n), reduced at segments that take longer than requested.

    The values at the start are not changed.
    """
    slower = np.divide(asked_s, spans_s, out=np.ones_like(spans_s), where=asked_s > 0.0)
    slower = np.minimum(slower, np.append(slower[1:], 1.0))[:, None]
    return (
        np.vstack((start.velocity, waypoints.velocity * slower)),
        np.vstack((start.acceleration, waypoints.acceleration * slower**2)),
    )


def _coefficients(
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    smooth: tuple[BoolArray, BoolArray],
    spans_s: FloatArray,
) -> FloatArray:
    """Return the coefficients (m, 6, n) of the segments between the (m + 1, n) states."""
    t = spans_s[:, None]
    p, v, a = position[:-1], velocity[:-1], acceleration[:-1]
    way, v2, a2 = position[1:] - p, velocity[1:], acceleration[1:]
    zero = np.zeros_like(p)
    linear = (p, way / t, zero, zero, zero, zero)
    cubic = (p, v, (3.0 * way / t - 2.0 * v - v2) / t, (v + v2 - 2.0 * way / t) / t**2, zero, zero)
    quintic = (
        p,
        v,
        a / 2.0,
        (20.0 * way / t - 12.0 * v - 8.0 * v2 - (3.0 * a - a2) * t) / (2.0 * t**2),
        (-30.0 * way / t + 16.0 * v + 14.0 * v2 + (3.0 * a - 2.0 * a2) * t) / (2.0 * t**3),
        (12.0 * way / t - 6.0 * v - 6.0 * v2 - (a - a2) * t) / (2.0 * t**4),
    )
    has_v, has_a = (has[:-1] & has[1:] for has in smooth)
    kinds = [(has_v & has_a)[:, None, None], has_v[:, None, None]]
    chosen: FloatArray = np.select(kinds, [np.stack(quintic, 1), np.stack(cubic, 1)], np.stack(linear, 1))
    return chosen


def _sample(coefficients: FloatArray, spans_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the positions (m, SAMPLES, n) of all segments, and the highest speeds of the segments (m, n)."""
    times = np.linspace(0.0, 1.0, SAMPLES)[None, :] * spans_s[:, None]
    powers = times[:, :, None] ** np.arange(6)
    positions: FloatArray = powers @ coefficients
    slopes = coefficients[:, 1:] * np.arange(1.0, 6.0)[:, None]
    speeds: FloatArray = np.abs(powers[:, :, :5] @ slopes).max(axis=1)
    return positions, speeds


def _check_positions(positions: FloatArray, limits: Sequence[JointLimits], names: Sequence[str]) -> None:
    lower, upper = swing_limits(positions[0, 0], limits)
    outside = (positions < lower) | (positions > upper)
    if not outside.any():
        return
    row, _, joint = (int(found[0]) for found in np.nonzero(outside))
    reached = positions[row, :, joint]
    far = reached[np.argmax(np.maximum(reached - upper[joint], lower[joint] - reached))]
    position, low, high = beyond_range(float(far), limits[joint].lower, limits[joint].upper)
    raise MotionError(
        f"{names[joint] if names else f'joint {joint + 1}'} would swing to {position} on the way to point #{row}, "
        f"outside its limits {low} to {high}: reduce the speed at the points near this limit"
    )
