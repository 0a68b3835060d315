"""Slow down a path recorded by hand to a requested speed and to the joint limits."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from controller.teach.hand_path import GRID_S, HandPath, kept_inside, tolerances
from controller.trajectory.goal import GoalPoint
from controller.trajectory.paths import FEW
from hal.types import FloatArray, JointLimits

SHARE: Final = 0.9
"""Fraction of the velocity and acceleration limits that paths may use. Lag compensation and smoothing need the
remaining fraction."""
LEAST: Final = FEW + 2
"""Minimum number of knots in a path, including the first knot."""
SPREAD: Final = 8
"""Number of samples before and after a slowed sample over which the speed changes gradually."""


def slowed(path: HandPath, limits: Sequence[JointLimits], speed: float) -> HandPath:
    """Return the path, executed at ``speed`` (0 to 1) times the speed of the hand.

    Where a joint would exceed its limits, all joints slow down together. The path itself is kept within the limits.
    """
    even = path.sampled(GRID_S * speed)
    times_s, velocity = even.times_s / speed, even.velocity * speed
    stretch = _spread(_needed(times_s, velocity, limits))
    spans_s = np.diff(times_s) * 0.5 * (stretch[1:] + stretch[:-1])
    slow = HandPath(np.append(0.0, np.cumsum(spans_s)), even.position, velocity / stretch[:, None])
    return kept_inside(slow, limits)


def _needed(times_s: FloatArray, velocity: FloatArray, limits: Sequence[JointLimits]) -> FloatArray:
    """Return the time-stretch factors (k,) at each sample that keep all joints within their limits."""
    fastest = SHARE * np.array([limit.velocity for limit in limits])
    strongest = SHARE * np.array([limit.acceleration for limit in limits])
    acceleration = np.gradient(velocity, times_s, axis=0)
    by_velocity = (np.abs(velocity) / fastest).max(axis=1)
    by_acceleration = np.sqrt((np.abs(acceleration) / strongest).max(axis=1))
    needed: FloatArray = np.maximum(1.0, np.maximum(by_velocity, by_acceleration))
    return needed


def _spread(needed: FloatArray) -> FloatArray:
    """Return a smooth curve (k,) that is never below ``needed`` (k,)."""
    width = 2 * SPREAD + 1
    largest = sliding_window_view(np.pad(needed, SPREAD, mode="edge"), width).max(axis=1)
    smooth: FloatArray = sliding_window_view(np.pad(largest, SPREAD, mode="edge"), width).mean(axis=1)
    return smooth


def goal_points(path: HandPath, limits: Sequence[JointLimits]) -> tuple[GoalPoint, ...]:
    """Return all knots except the first as points of a trajectory goal. The joints start at the first knot.

    The trajectory has more points than the planner accepts for ruckig, which makes the planner use a smoothed spline.
    """
    thin = path.thinned(tolerances(limits)).divided(LEAST)
    rows = zip(thin.times_s[1:], thin.position[1:], thin.velocity[1:], strict=True)
    return tuple(GoalPoint(tuple(at.tolist()), float(time_s), tuple(speed.tolist())) for time_s, at, speed in rows)
