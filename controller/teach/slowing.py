"""The speed of a path that a hand has shown: as it was shown or slower, and nowhere faster than the joints can."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from controller.teach.hand_path import GRID_S, HandPath, kept_inside, tolerances
from controller.trajectory.goal import GoalPoint
from controller.trajectory.paths import FEW
from hal.types import FloatArray, JointLimits

SHARE: Final = 0.9
"""Of velocity and acceleration limits: the rest makes up for the servos' lag, and is for the smoothing behind this."""
LEAST: Final = FEW + 2
"""Knots of a path, the first one among them."""
SPREAD: Final = 8
"""Samples around each that are slowed down with it, and slowly so."""


def slowed(path: HandPath, limits: Sequence[JointLimits], speed: float) -> HandPath:
    """The path at ``speed`` (0 to 1) times the hand's speed; where joints cannot do that, all together as fast as they
    can. The way is the same, within the limits."""
    even = path.sampled(GRID_S * speed)
    times_s, velocity = even.times_s / speed, even.velocity * speed
    stretch = _spread(_needed(times_s, velocity, limits))
    spans_s = np.diff(times_s) * 0.5 * (stretch[1:] + stretch[:-1])
    slow = HandPath(np.append(0.0, np.cumsum(spans_s)), even.position, velocity / stretch[:, None])
    return kept_inside(slow, limits)


def _needed(times_s: FloatArray, velocity: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """How many times longer than it is each moment (k,) must take for all joints."""
    fastest = SHARE * np.array([limit.velocity for limit in limits])
    strongest = SHARE * np.array([limit.acceleration for limit in limits])
    acceleration = np.gradient(velocity, times_s, axis=0)
    by_velocity = (np.abs(velocity) / fastest).max(axis=1)
    by_acceleration = np.sqrt((np.abs(acceleration) / strongest).max(axis=1))
    needed: FloatArray = np.maximum(1.0, np.maximum(by_velocity, by_acceleration))
    return needed


def _spread(needed: FloatArray) -> FloatArray:
    """No less than ``needed`` (k,) anywhere, and without its edges."""
    width = 2 * SPREAD + 1
    largest = sliding_window_view(np.pad(needed, SPREAD, mode="edge"), width).max(axis=1)
    smooth: FloatArray = sliding_window_view(np.pad(largest, SPREAD, mode="edge"), width).mean(axis=1)
    return smooth


def goal_points(path: HandPath, limits: Sequence[JointLimits]) -> tuple[GoalPoint, ...]:
    """The knots behind the first one, where the joints are, as the points of a trajectory goal.

    They are more than the planner would join in ways of its own, which are none of the hand's.
    """
    thin = path.thinned(tolerances(limits)).divided(LEAST)
    rows = zip(thin.times_s[1:], thin.position[1:], thin.velocity[1:], strict=True)
    return tuple(GoalPoint(tuple(at.tolist()), float(time_s), tuple(speed.tolist())) for time_s, at, speed in rows)
