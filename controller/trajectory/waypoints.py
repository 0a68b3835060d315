"""Plan a jerk-limited motion through a few waypoints with ruckig."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.motion import Kinematics, RuckigMotion, segment
from hal.types import FloatArray, JointLimits

ATTEMPTS: Final = 4
"""Maximum number of times the planner chooses new velocities if the time between two points is too short."""
ACCELERATION_SHARE: Final = 0.5
"""Fraction of the acceleration limit that chosen velocities use. The jerk-limited ramps need the remaining fraction."""

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Waypoints:
    """m points for n joints. ``times_s`` (m,) are measured from now. The other arrays (m, n) are in rad or m and
    seconds.

    ``has_velocity`` and ``has_acceleration`` (m,) mark the points for which the goal specifies these values. At the
    other points, the values are 0. Accelerations without velocities are ignored (ros2_control waits at such points,
    then jumps).
    """

    times_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    has_velocity: BoolArray
    has_acceleration: BoolArray

    def by_shortest_turn(self, start: FloatArray, endless: Sequence[int]) -> "Waypoints":
        """Return the points shifted by full turns so that continuous joints move away from ``start`` (n,) in the
        shorter direction.

        ``endless`` holds the indices of the continuous joints.
        """
        columns = list(endless)
        turns = np.round((start[columns] - self.position[0, columns]) / math.tau)
        position = self.position.copy()
        position[:, columns] += turns * math.tau
        return replace(self, position=position)


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
    start: Kinematics, waypoints: Waypoints, limits: Sequence[JointLimits], names: Sequence[str] = ()
) -> RuckigMotion:
    """Plan a motion with ruckig from ``start`` through every point without stopping. Raises MotionError.

    If a segment takes longer than requested, the velocities at its ends are reduced accordingly, so that all joints
    stay on the path.
    """
    bounds = Bounds.of(limits)
    positions = np.vstack((start.position, waypoints.position))
    asked_s = np.maximum(np.diff(waypoints.times_s, prepend=0.0), 0.0)
    spans_s = np.maximum(asked_s, (np.abs(np.diff(positions, axis=0)) / bounds.velocity).max(axis=1))
    for _ in range(ATTEMPTS):
        states = _states(waypoints, positions, start, asked_s, spans_s, bounds)
        pairs = zip(pairwise(states), spans_s, strict=True)
        trajectories = [segment(before, after, limits, span_s, names) for (before, after), span_s in pairs]
        durations_s = np.array([trajectory.duration for trajectory in trajectories])
        if (durations_s <= spans_s * 1.001 + 1e-4).all():
            break
        spans_s = np.maximum(spans_s, durations_s)
    asked = max(float(waypoints.times_s[-1]), 0.0)
    return RuckigMotion.of(trajectories, asked)


def _states(
    waypoints: Waypoints,
    positions: FloatArray,
    start: Kinematics,
    asked_s: FloatArray,
    spans_s: FloatArray,
    bounds: Bounds,
) -> list[Kinematics]:
    """Return the states at the start and at each point.

    Values that the goal does not specify are estimated. At the ends of segments that take longer than requested,
    velocities are reduced.
    """
    slower = np.divide(asked_s, spans_s, out=np.ones_like(spans_s), where=(asked_s > 0.0) & (spans_s > 0.0))
    slower = np.minimum(slower, np.append(slower[1:], 1.0))[:, None]
    velocity = np.where(
        waypoints.has_velocity[:, None], waypoints.velocity * slower, _velocities(positions, start, spans_s, bounds)
    )
    acceleration = np.where(
        waypoints.has_acceleration[:, None],
        waypoints.acceleration * slower**2,
        # An acceleration of 0 would interrupt the motion's acceleration at each point.
        estimated_velocities(np.vstack((start.velocity, velocity)), spans_s),
    )
    velocity[-1], acceleration[-1] = 0.0, 0.0
    return [start, *(within(Kinematics(*s), bounds) for s in zip(positions[1:], velocity, acceleration, strict=True))]


def within(state: Kinematics, bounds: Bounds) -> Kinematics:
    """Limit a state so that ruckig accepts it as a target.

    Near the velocity limit, the jerk limit must be able to bring the acceleration to 0 in time.
    """
    velocity = np.clip(state.velocity, -bounds.velocity, bounds.velocity)
    room = np.minimum(bounds.acceleration, np.sqrt(2.0 * bounds.jerk * (bounds.velocity - np.abs(velocity))))
    return Kinematics(state.position, velocity, np.clip(state.acceleration, -room, room))


def _velocities(positions: FloatArray, start: Kinematics, spans_s: FloatArray, bounds: Bounds) -> FloatArray:
    """Estimate velocities (m, n) that are low enough for the joints to reach the next point at the velocity of that
    point."""
    distances = np.abs(np.diff(positions, axis=0))
    chosen = estimated_velocities(positions, spans_s)
    speed, reach = np.abs(chosen), 2.0 * ACCELERATION_SHARE * bounds.acceleration * distances
    for row in range(len(speed) - 2, -1, -1):
        speed[row] = np.minimum(speed[row], np.sqrt(speed[row + 1] ** 2 + reach[row + 1]))
    previous = np.abs(start.velocity)
    for row in range(len(speed)):
        speed[row] = previous = np.minimum(speed[row], np.sqrt(previous**2 + reach[row]))
    return np.copysign(speed, chosen)


def estimated_velocities(positions: FloatArray, spans_s: FloatArray) -> FloatArray:
    """Return the smaller of the two slopes at each point except the first, shape (m, n).

    The velocity is 0 where a joint reverses its direction, and at the end.
    """
    slopes = np.diff(positions, axis=0) / np.maximum(spans_s, 1e-6)[:, None]
    before, after = slopes, np.vstack((slopes[1:], np.zeros_like(slopes[:1])))
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0.0, smaller, 0.0)
