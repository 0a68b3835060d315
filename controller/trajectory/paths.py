"""Paths through several points, and the way to a point of a path from where the joints have moved to meanwhile."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.motion import Kinematics, Motion, MotionError, Path, motion_to, stretched
from controller.trajectory.smoothing import smooth_path
from controller.trajectory.splines import SplinePath, spline
from controller.trajectory.waypoints import Bounds, Waypoints, ruckig_motion, within
from hal.types import FloatArray, JointLimits

FEW: Final = 50
"""Up to so many points are tried with ruckig, which passes each of them exactly."""

BEGINNING_S: Final = 0.3
"""Within this time a path is on its plan, wherever it began."""
NEAR: Final = 0.05
"""rad or m: as far from the commanded position may lie what is measured, by sag, play and following error."""


@dataclass(frozen=True, slots=True)
class Task:
    """All that a plan is made from; ``limits`` and ``names`` in joint order."""

    start: Kinematics
    waypoints: Waypoints
    limits: tuple[JointLimits, ...]
    names: tuple[str, ...]


def begun_at(waypoints: Waypoints, here: FloatArray) -> Waypoints:
    """The same points but for the first ones, which lead from ``here`` (n,) onto the plan.

    Planners begin at what is measured, a little beside what is commanded. A step between the two would cost the
    whole path its time: bends are as smooth everywhere as the sharpest must be.
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


def spline_path(task: Task) -> tuple[Path, FloatArray]:
    """A spline, and when (m,) it passes each point. Raises MotionError."""
    path = spline(task.start, task.waypoints, task.limits, task.names)
    return path, _passes(path)


def jerk_limited_path(task: Task) -> tuple[Path, FloatArray]:
    """A path by ruckig where it passes few points in the time asked for; where limits or close points would hold it
    up, whichever is the shorter; and when (m,) it passes each point. Raises MotionError."""
    exact = _exact(task)
    if exact is not None:
        passes_s = np.array([*exact.starts_s[1:], exact.duration_s])
        if not stretched(exact):
            return exact, passes_s
    smooth = smooth_path(task.start, task.waypoints, task.limits, task.names)
    if exact is not None and exact.duration_s <= smooth.duration_s:
        return exact, passes_s
    later = _passes(smooth.spline) + sum(smooth.windows_s) / 2.0
    later[-1] = smooth.duration_s
    return smooth, later


def _exact(task: Task) -> Motion | None:
    """Return the path through few points by ruckig, or None if it would leave the position limits between them."""
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
    """Two paths in one: ``first``, and then ``rest`` from ``from_s`` on."""

    first: Path
    rest: Path
    from_s: float
    asked_s: float

    @property
    def duration_s(self) -> float:
        """The duration of both paths together."""
        return self.first.duration_s + max(self.rest.duration_s - self.from_s, 0.0)

    def sample(self, time_s: float) -> Kinematics:
        """The joints' movement ``time_s`` after the start."""
        if time_s < self.first.duration_s:
            return self.first.sample(time_s)
        return self.rest.sample(self.from_s + time_s - self.first.duration_s)


def smooth_lead(task: Task, reference: Kinematics, target: Kinematics, index: int, span_s: float) -> Path:
    """The jerk-limited way from ``reference`` to the path's state ``target`` at the point ``index``."""
    return motion_to(reference, within(target, Bounds.of(task.limits)), task.limits, span_s, task.names)


def spline_lead(task: Task, reference: Kinematics, target: Kinematics, index: int, span_s: float) -> Path:
    """The same way as a spline, linear, cubic or quintic as the point is."""
    way = Waypoints(
        np.array([span_s]),
        target.position[None],
        target.velocity[None],
        target.acceleration[None],
        task.waypoints.has_velocity[index : index + 1],
        task.waypoints.has_acceleration[index : index + 1],
    )
    return spline(reference, way, task.limits, task.names)
