"""Generate plans like those of MoveIt: 100 Hz, with rounded velocities and accelerations up to the limits."""

from collections.abc import Callable, Sequence

import numpy as np

from controller.trajectory.goal import GoalPoint
from hal.types import FloatArray, JointLimits

STEP_S = 0.01
ROUNDING = 1.0 + 2e-11
"""Relative excess over the limits at the peaks of real plans."""

Curve = Callable[[FloatArray], FloatArray]
"""Function that returns positions (n, m) for distances (m,) along the path, from 0 to 1."""


def straight(start: Sequence[float], end: Sequence[float]) -> Curve:
    """Return a straight line through joint space."""
    first, way = np.array(start)[:, None], (np.array(end) - np.array(start))[:, None]
    return lambda along: first + way * along


def curved(start: Sequence[float], end: Sequence[float], bow: Sequence[float]) -> Curve:
    """Return a curve that deviates from a straight line by ``bow`` in its middle, as around an obstacle."""
    line, far = straight(start, end), np.array(bow)[:, None]
    return lambda along: line(along) + far * np.sin(np.pi * along) ** 2


def plan(curve: Curve, limits: Sequence[JointLimits], scale: float = 1.0) -> list[GoalPoint]:
    """Return the fastest plan along a curve with a smooth speed, at ``scale`` times the limits."""
    velocity, acceleration = scale * np.array([(limit.velocity, limit.acceleration) for limit in limits]).T
    duration_s = 0.2
    while True:
        times_s = np.append(np.arange(0.0, duration_s, STEP_S), duration_s)
        position, speed, push = _sampled(curve, times_s / duration_s, duration_s)
        excess = max(
            float((np.abs(speed).max(axis=1) / velocity).max()),
            float(np.sqrt((np.abs(push).max(axis=1) / acceleration).max())),
        )
        if excess <= 1.0:
            break
        duration_s *= max(excess, 1.001)
    top = np.maximum(np.abs(speed).max(axis=1) / velocity, np.sqrt(np.abs(push).max(axis=1) / acceleration)).max()
    times_s, speed, push = times_s * top, speed / top * ROUNDING, push / top**2 * ROUNDING
    return [
        GoalPoint(tuple(p), float(t), tuple(v), tuple(a))
        for p, t, v, a in zip(position.T, times_s, speed.T, push.T, strict=True)
    ]


def trapezoid(start: Sequence[float], end: Sequence[float], limits: Sequence[JointLimits]) -> list[GoalPoint]:
    """Return a straight line that always moves at a limit, like MoveIt's time parameterization without a jerk limit."""
    first, way = np.array(start), np.array(end) - np.array(start)
    share = np.maximum(np.abs(way), 1e-9)
    velocity, acceleration = (
        min(getattr(limit, kind) / far for limit, far in zip(limits, share.tolist(), strict=True))
        for kind in ("velocity", "acceleration")
    )
    ramp_s = min(velocity / acceleration, acceleration**-0.5)
    duration_s = 1.0 / (acceleration * ramp_s) + ramp_s
    points = []
    for time_s in np.append(np.arange(0.0, duration_s, 5 * STEP_S), duration_s).tolist():
        since_s, left_s = min(time_s, ramp_s), min(duration_s - time_s, ramp_s)
        cruise_s = time_s - since_s - (ramp_s - left_s)
        ramps = since_s**2 + ramp_s**2 - left_s**2
        along = acceleration * (ramps / 2.0 + ramp_s * cruise_s)
        speed = acceleration * min(since_s, left_s)
        push = acceleration * ((time_s < ramp_s) - (duration_s - time_s < ramp_s))
        points.append(GoalPoint(tuple(first + way * along), time_s, tuple(way * speed), tuple(way * push)))
    return points


def _sampled(curve: Curve, share: FloatArray, duration_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions, velocities and accelerations (n, m) with a smooth speed along a curve, at rest at both ends."""
    fine = np.linspace(0.0, 1.0, 4001)
    along = fine**3 * (10.0 - 15.0 * fine + 6.0 * fine**2)
    position = curve(along)
    step_s = duration_s / 4000
    speed = np.gradient(position, step_s, axis=1)
    push = np.gradient(speed, step_s, axis=1)
    speed[:, [0, -1]], push[:, [0, -1]] = 0.0, 0.0
    found = (np.array([np.interp(share, fine, row) for row in values]) for values in (position, speed, push))
    return next(found), next(found), next(found)


def off_path(positions: FloatArray, points: Sequence[GoalPoint]) -> float:
    """Return the largest distance (rad, any joint) of positions (k, n) from the nearest point of a plan."""
    return off_line(positions, np.array([point.positions for point in points]))


def off_line(positions: FloatArray, corners: FloatArray) -> float:
    """Return the largest distance (rad, any joint) of positions (k, n) from a line through ``corners`` (m, n)."""
    fine = np.linspace(0.0, len(corners) - 1.0, 40 * len(corners))
    line = np.array([np.interp(fine, np.arange(len(corners)), column) for column in corners.T]).T
    return max(float(np.abs(line - at).max(axis=1).min()) for at in positions)
