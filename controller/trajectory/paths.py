"""Plan paths through several points, and motions from the current joint positions to a point on a path."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.motion import Kinematics, MotionError, Path, RuckigMotion, motion_to, stretched
from controller.trajectory.smoothing import SmoothPath, smooth_path
from controller.trajectory.splines import SplinePath, spline
from controller.trajectory.waypoints import Bounds, Waypoints, ruckig_motion, within
from hal.types import FloatArray, JointLimits

FEW: Final = 50
"""Maximum number of points for which ruckig is tried. Ruckig passes through each point exactly."""

MISSES: Final = 0.02
"""Maximum distance by which a smoothed spline may miss a point if there are few points, in rad or m."""
SLOWER: Final = 1.2
"""Factor by which a spline that misses a point is slowed down."""
SLOWEST: Final = 10.0
"""Maximum factor by which a spline is slowed down. The distance to the missed point decreases with the fourth power of
the factor."""
SAMPLES: Final = 21
"""Number of samples that are compared with each point. The samples cover the windows that are used to smooth the spline
near the point.
"""
BEGINNING_S: Final = 0.3
"""Time that a path takes to return to its plan if it starts away from the plan, in seconds."""
NEAR: Final = 0.05
"""Maximum distance of the measured position from the commanded position, in rad or m. This distance allows for sag,
backlash and following error.
"""


@dataclass(frozen=True, slots=True)
class PathTask:
    """Input for planning. ``limits`` and ``names`` are in joint order."""

    start: Kinematics
    waypoints: Waypoints
    limits: tuple[JointLimits, ...]
    names: tuple[str, ...]


def begun_at(waypoints: Waypoints, here: FloatArray) -> Waypoints:
    """Shift the first points so that they lead from ``here`` (n,) to the remaining points.

    Planners start from the measured position, which differs slightly from the commanded position. A step between the
    two positions would slow down the whole path, because the sharpest bend of the path determines the smoothing.
    """
    times_s, position = waypoints.times_s, waypoints.position
    lasts_s = min(BEGINNING_S, float(times_s[-1]))
    if times_s[0] > 0.0 or lasts_s <= 0.0:
        return waypoints
    begins = np.array([np.interp(0.0, times_s, column) for column in position.T])
    offset = np.where(np.abs(here - begins) <= NEAR, here - begins, 0.0)
    u = np.clip(times_s / lasts_s, 0.0, 1.0)[:, None]
    return replace(
        waypoints,
        position=position + offset * (1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)),
        velocity=waypoints.velocity - offset * 30.0 * (u * (1.0 - u)) ** 2 / lasts_s,
        acceleration=waypoints.acceleration - offset * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / lasts_s**2,
    )


def spline_path(task: PathTask) -> tuple[Path, FloatArray]:
    """Return a spline and the times (m,) at which it passes each point. Raises MotionError."""
    path = spline(task.start, task.waypoints, task.limits, task.names)
    return path, _passes(path)


def jerk_limited_path(task: PathTask) -> tuple[Path, FloatArray]:
    """Return a jerk-limited path and the times (m,) at which it passes each point. Raises MotionError.

    If there are few points, and ruckig's path does not take longer than requested, this path is used. Otherwise, the
    shorter of ruckig's path and a smoothed spline is used. Few points may be far apart, so the spline is slowed down
    until it passes close to all of them.
    """
    exact = _exact(task)
    if exact is not None:
        passes_s = np.array([*exact.starts_s[1:], exact.duration_s])
        if not stretched(exact):
            return exact, passes_s
    smooth = _smooth(task)
    if exact is not None and exact.duration_s <= smooth.duration_s:
        return exact, passes_s
    later = _passes(smooth.spline) + sum(smooth.windows_s) / 2.0
    later[-1] = smooth.duration_s
    return smooth, later


def _smooth(task: PathTask) -> SmoothPath:
    """Return the smoothed spline.

    If there are few points, the spline is slowed down until it does not miss any point by more than ``MISSES``.
    """
    smooth = smooth_path(task.start, task.waypoints, task.limits, task.names)
    if len(task.waypoints.times_s) > FEW:
        return smooth
    asked_s, factor = smooth.asked_s, 1.0
    while _largest_miss(smooth, task.waypoints.position) > MISSES and factor < SLOWEST:
        factor *= SLOWER
        smooth = smooth_path(task.start, _slowed(task.waypoints, factor), task.limits, task.names)
    return replace(smooth, spline=replace(smooth.spline, asked_s=asked_s))


def _slowed(waypoints: Waypoints, factor: float) -> Waypoints:
    return replace(
        waypoints,
        times_s=waypoints.times_s * factor,
        velocity=waypoints.velocity / factor,
        acceleration=waypoints.acceleration / factor**2,
    )


def _largest_miss(path: SmoothPath, points: FloatArray) -> float:
    """Return the largest deviation of any joint between the path and any of the points (m, n), in rad or m."""
    window_s = sum(path.windows_s)
    near_s = _passes(path.spline)[:, None] + np.linspace(0.0, window_s, SAMPLES)
    samples = np.array([[path.sample(time_s).position for time_s in row] for row in near_s.tolist()])
    return float(np.abs(samples - points[:, None]).max(axis=2).min(axis=1).max())


def _exact(task: PathTask) -> RuckigMotion | None:
    """Return ruckig's path through a few points, or None if it would exceed the position limits between them."""
    if len(task.waypoints.times_s) > FEW:
        return None
    try:
        return ruckig_motion(task.start, task.waypoints, task.limits, task.names)
    except MotionError:
        return None


def _passes(path: SplinePath) -> FloatArray:
    return np.array([*path.starts_s[1:], path.duration_s])


@dataclass(frozen=True, slots=True)
class Joined:
    """A path that consists of ``first``, followed by the part of ``rest`` that starts at ``from_s``."""

    first: Path
    rest: Path
    from_s: float
    asked_s: float

    @property
    def duration_s(self) -> float:
        """Total duration of both parts, in seconds."""
        return self.first.duration_s + max(self.rest.duration_s - self.from_s, 0.0)

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start."""
        if time_s < self.first.duration_s:
            return self.first.sample(time_s)
        return self.rest.sample(self.from_s + time_s - self.first.duration_s)


def smooth_lead(task: PathTask, reference: Kinematics, target: Kinematics, index: int, span_s: float) -> Path:
    """Plan a jerk-limited motion from ``reference`` to ``target``, the state of the path at the point ``index``."""
    return motion_to(reference, within(target, Bounds.of(task.limits)), task.limits, span_s, task.names)


def spline_lead(task: PathTask, reference: Kinematics, target: Kinematics, index: int, span_s: float) -> Path:
    """Plan a spline from ``reference`` to ``target``: linear, cubic or quintic, depending on the data of the point."""
    waypoint = Waypoints(
        np.array([span_s]),
        target.position[None],
        target.velocity[None],
        target.acceleration[None],
        task.waypoints.has_velocity[index : index + 1],
        task.waypoints.has_acceleration[index : index + 1],
    )
    return spline(reference, waypoint, task.limits, task.names)
