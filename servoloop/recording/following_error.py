"""Compute the following error of a run: the difference between its references and its positions."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray

MOVING_RAD_S = 0.01
REST_S = 0.5
"""Time from the end of the reference motion until the joint must be at rest, in seconds."""


@dataclass(frozen=True, slots=True)
class FollowingError:
    """Following error of each joint of the arm in one run, in rad. All values are empty if there are no measurements.

    Sag is largest at the joints that support the arm. Lag is largest at the joint that moves fastest.
    """

    largest_rad: tuple[float, ...]
    rms_moving_rad: tuple[float, ...]
    at_rest_rad: tuple[float, ...]
    """Largest error at rest, or 0 for joints that were never at rest."""
    fastest: int
    """Index of the joint with the largest reference velocity."""

    def as_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        """Return the values of the worst joint, the fastest joint and all joints, for result.json.

        ``joints`` are the names of the arm's joints.
        """
        if not self.largest_rad:
            return {"largest_rad": None, "rms_moving_rad": None, "at_rest_rad": None}
        return {
            "largest_rad": max(self.largest_rad),
            "rms_moving_rad": max(self.rms_moving_rad),
            "at_rest_rad": max(self.at_rest_rad),
            "fastest_joint": {
                "joint": joints[self.fastest],
                "largest_rad": self.largest_rad[self.fastest],
                "rms_moving_rad": self.rms_moving_rad[self.fastest],
            },
            "by_joint": {
                "largest_rad": self.largest_rad,
                "rms_moving_rad": self.rms_moving_rad,
                "at_rest_rad": self.at_rest_rad,
            },
        }


UNKNOWN = FollowingError((), (), (), 0)


def following_error(times_s: FloatArray, error: FloatArray, velocity: FloatArray) -> FollowingError:
    """Compute the following error from position errors and reference velocities, both with shape (samples, joints)."""
    if not len(error):
        return UNKNOWN
    moving = np.abs(velocity) > MOVING_RAD_S
    count = np.maximum(moving.sum(axis=0), 1)
    rms = np.sqrt((np.where(moving, error, 0.0) ** 2).sum(axis=0) / count)
    fastest = int(np.abs(velocity).max(axis=0).argmax())
    at_rest = np.where(_rests(times_s, moving), np.abs(error), 0.0).max(axis=0)
    return FollowingError(_rounded(np.abs(error).max(axis=0)), _rounded(rms), _rounded(at_rest), fastest)


def _rests(times_s: FloatArray, moving: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return whether the reference of each joint has been at rest for ``REST_S``, with shape (samples, joints)."""
    last = np.maximum.accumulate(np.where(moving, times_s[:, None], times_s[0]), axis=0)
    return times_s[:, None] - last >= REST_S


def worst(errors: Iterable[FollowingError]) -> FollowingError:
    """Return each joint's largest following error over several runs."""
    known = [error for error in errors if error.largest_rad]
    if not known:
        return UNKNOWN
    largest = np.max([error.largest_rad for error in known], axis=0)
    rms = np.max([error.rms_moving_rad for error in known], axis=0)
    at_rest = np.max([error.at_rest_rad for error in known], axis=0)
    return FollowingError(_rounded(largest), _rounded(rms), _rounded(at_rest), known[0].fastest)


def _rounded(values: FloatArray) -> tuple[float, ...]:
    return tuple(round(float(value), 5) for value in values)


def reference_at(
    times_s: FloatArray, cycle_s: FloatArray, position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interpolate reference positions and velocities between cycles with cubic polynomials; the shape is (times,
    joints)."""
    left = np.clip(np.searchsorted(cycle_s, times_s, side="right") - 1, 0, len(cycle_s) - 2)
    span = (cycle_s[left + 1] - cycle_s[left])[:, None]
    u = (times_s - cycle_s[left])[:, None] / span
    p0, p1 = position[left], position[left + 1]
    v0, v1 = velocity[left] * span, velocity[left + 1] * span
    a, b = 2 * (p0 - p1) + v0 + v1, 3 * (p1 - p0) - 2 * v0 - v1
    return ((a * u + b) * u + v0) * u + p0, ((3 * a * u + 2 * b) * u + v0) / span


def between_cycles(
    trace_s: Sequence[float],
    trace: Sequence[Sequence[float] | FloatArray],
    cycle_s: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
) -> FollowingError:
    """Return the following error of a dense trace (times, joints) relative to the cycles' references."""
    if len(cycle_s) < 2 or not len(trace):
        return UNKNOWN
    times, actual = np.array(trace_s), np.array(trace)
    inside = (times >= cycle_s[0]) & (times <= cycle_s[-1])
    reference, speed = reference_at(times[inside], cycle_s, position, velocity)
    return following_error(times[inside], reference - actual[inside], speed)
