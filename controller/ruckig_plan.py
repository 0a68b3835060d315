"""A course of few points as jerk-limited motion that passes each of them, by ruckig."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from controller.motion import Kinematics, Motion, end_to_end, segment
from controller.way_points import Course
from hal.types import FloatArray, JointLimits

ATTEMPTS: Final = 4
"""So often velocities are chosen anew where the time between two points has turned out too short."""
ACCELERATION_SHARE: Final = 0.5
"""What chosen velocities use of the acceleration limit; the rest is for building it up within the jerk limit."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of n joints, each of shape (n,)."""

    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @classmethod
    def of(cls, limits: Sequence[JointLimits]) -> "Bounds":
        return cls(
            np.array([limit.velocity for limit in limits]),
            np.array([limit.acceleration for limit in limits]),
            np.array([limit.jerk for limit in limits]),
        )


def ruckig_motion(
    start: Kinematics, course: Course, limits: Sequence[JointLimits], names: Sequence[str] = ()
) -> Motion:
    """From ``start`` through every point without stopping. Raises MotionError.

    Where a way takes longer than the goal says, it and the velocities at its ends are slowed down
    together, so that all joints stay on the way.
    """
    bounds = Bounds.of(limits)
    positions = np.vstack((start.position, course.position))
    asked_s = np.maximum(np.diff(course.times_s, prepend=0.0), 0.0)
    spans_s = np.maximum(asked_s, (np.abs(np.diff(positions, axis=0)) / bounds.velocity).max(axis=1))
    for _ in range(ATTEMPTS):
        states = _states(course, positions, start, asked_s, spans_s, bounds)
        pairs = zip(pairwise(states), spans_s, strict=True)
        trajectories = [segment(before, after, limits, span_s, names) for (before, after), span_s in pairs]
        durations_s = np.array([trajectory.duration for trajectory in trajectories])
        if (durations_s <= spans_s * 1.001 + 1e-4).all():
            break
        spans_s = np.maximum(spans_s, durations_s)
    asked = max(float(course.times_s[-1]), 0.0)
    return Motion(trajectories[0], asked, end_to_end(trajectories[1:]), trajectories[0].duration)


def _states(
    course: Course, positions: FloatArray, start: Kinematics, asked_s: FloatArray, spans_s: FloatArray, bounds: Bounds
) -> list[Kinematics]:
    """At the start and at each point: what the goal gives, slowed down where it has to be, or else an estimate."""
    slower = np.divide(asked_s, spans_s, out=np.ones_like(spans_s), where=(asked_s > 0.0) & (spans_s > 0.0))
    slower = np.minimum(slower, np.append(slower[1:], 1.0))[:, None]
    velocity = np.where(
        course.has_velocity[:, None], course.velocity * slower, _velocities(positions, start, spans_s, bounds)
    )
    acceleration = np.where(
        course.has_acceleration[:, None],
        course.acceleration * slower**2,
        estimated_velocities(np.vstack((start.velocity, velocity)), spans_s),  # 0 would stop accelerating at each
    )
    velocity[-1], acceleration[-1] = 0.0, 0.0
    return [start, *(within(Kinematics(*s), bounds) for s in zip(positions[1:], velocity, acceleration, strict=True))]


def within(state: Kinematics, bounds: Bounds) -> Kinematics:
    """A state that ruckig takes for a target: where velocity is near its limit, acceleration must have
    time to go before and after."""
    velocity = np.clip(state.velocity, -bounds.velocity, bounds.velocity)
    room = np.minimum(bounds.acceleration, np.sqrt(2.0 * bounds.jerk * (bounds.velocity - np.abs(velocity))))
    return Kinematics(state.position, velocity, np.clip(state.acceleration, -room, room))


def _velocities(positions: FloatArray, start: Kinematics, spans_s: FloatArray, bounds: Bounds) -> FloatArray:
    """Estimates that are never so fast that the next point could not be met at its velocity (m, n)."""
    ways = np.abs(np.diff(positions, axis=0))
    chosen = estimated_velocities(positions, spans_s)
    speed, reach = np.abs(chosen), 2.0 * ACCELERATION_SHARE * bounds.acceleration * ways
    for row in range(len(speed) - 2, -1, -1):
        speed[row] = np.minimum(speed[row], np.sqrt(speed[row + 1] ** 2 + reach[row + 1]))
    previous = np.abs(start.velocity)
    for row in range(len(speed)):
        speed[row] = previous = np.minimum(speed[row], np.sqrt(previous**2 + reach[row]))
    return np.copysign(speed, chosen)


def estimated_velocities(positions: FloatArray, spans_s: FloatArray) -> FloatArray:
    """The smaller slope beside each point but the first (m, n), 0 where a joint turns round and at the end."""
    slopes = np.diff(positions, axis=0) / np.maximum(spans_s, 1e-6)[:, None]
    before, after = slopes, np.vstack((slopes[1:], np.zeros_like(slopes[:1])))
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0.0, smaller, 0.0)
