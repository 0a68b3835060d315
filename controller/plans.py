"""From a course to a path, by the interpolation method that the controller's parameters name.

A plan is prepared in the thread that takes goals, from where the joints are then. The loop's thread
only joins it: it plans the way to the first point anew where the joints have moved since.
"""

from bisect import bisect_right
from dataclasses import dataclass
from typing import Final, Literal, Protocol

import numpy as np

from controller.motion import Kinematics, Motion, Path, segment, stretched
from controller.ruckig_plan import Bounds, ruckig_motion, within
from controller.smoothing import smooth_path
from controller.splines import SplinePath, spline
from controller.way_points import Course, first_ahead
from hal.types import FloatArray, JointLimits

Method = Literal["splines", "none", "ruckig"]

FEW: Final = 50
"""Up to so many points are tried with ruckig, which passes each of them exactly."""


class Plan(Protocol):
    """What is ready when the goal is accepted."""

    def join(self, reference: Kinematics, waited_s: float) -> Path:
        """The path from where the joints are now; the points' times have come ``waited_s`` nearer.

        Raises MotionError.
        """
        ...


@dataclass(frozen=True, slots=True)
class Task:
    """What all plans are made from; ``limits`` and ``names`` in joint order."""

    start: Kinematics
    course: Course
    limits: tuple[JointLimits, ...]
    names: tuple[str, ...]


def prepare(method: Method, task: Task) -> Plan:
    """Raises MotionError where there is no way within the limits."""
    if method == "none":
        return StepPlan(task.course)
    return _splines(task) if method == "splines" else _jerk_limited(task)


@dataclass(frozen=True, slots=True)
class Joined:
    """``first``, and then ``rest`` from ``from_s`` on."""

    first: Path
    rest: Path
    from_s: float
    asked_s: float

    @property
    def duration_s(self) -> float:
        """Of both."""
        return self.first.duration_s + max(self.rest.duration_s - self.from_s, 0.0)

    def sample(self, time_s: float) -> Kinematics:
        """Where the joints are ``time_s`` after the start."""
        if time_s < self.first.duration_s:
            return self.first.sample(time_s)
        return self.rest.sample(self.from_s + time_s - self.first.duration_s)


@dataclass(frozen=True, slots=True)
class PathPlan:
    """A whole path, and when (m,) it passes each point."""

    task: Task
    path: Path
    passes_s: FloatArray
    smooth: bool
    """Whether the way to it is by ruckig."""

    def join(self, reference: Kinematics, waited_s: float) -> Path:
        """The path itself where nothing has changed, or else a way to its first point that lies ahead."""
        if not waited_s and self._still_there(reference):
            return self.path
        course = self.task.course
        index = first_ahead(course.times_s, waited_s)
        span_s = max(float(course.times_s[index]) - waited_s, 0.0)
        from_s = float(self.passes_s[index])
        target = self.path.sample(from_s)
        first = self._lead(reference, target, index, span_s)
        return Joined(first, self.path, from_s, max(float(course.times_s[-1]) - waited_s, 0.0))

    def _still_there(self, reference: Kinematics) -> bool:
        moving = reference.velocity.any() or reference.acceleration.any()
        return not moving and np.allclose(reference.position, self.task.start.position, rtol=0.0, atol=1e-9)

    def _lead(self, reference: Kinematics, target: Kinematics, index: int, span_s: float) -> Path:
        limits, names, course = self.task.limits, self.task.names, self.task.course
        if self.smooth:
            trajectory = segment(reference, within(target, Bounds.of(limits)), limits, span_s, names)
            return Motion(trajectory, span_s)
        way = Course(
            np.array([span_s]),
            target.position[None],
            target.velocity[None],
            target.acceleration[None],
            course.has_velocity[index : index + 1],
            course.has_acceleration[index : index + 1],
        )
        return spline(reference, way, limits, names)


def _splines(task: Task) -> PathPlan:
    path = spline(task.start, task.course, task.limits, task.names)
    return PathPlan(task, path, _passes(path), smooth=False)


def _jerk_limited(task: Task) -> PathPlan:
    """By ruckig where it passes few points in the time asked for; where limits or close points would
    hold it up, whichever is the shorter."""
    course, exact = task.course, None
    if len(course.times_s) == 1:  # what most clients send, and wait for
        target, asked_s = Kinematics.at_rest(course.position[0]), max(float(course.times_s[0]), 0.0)
        only = Motion(segment(task.start, target, task.limits, asked_s, task.names), asked_s)
        return PathPlan(task, only, np.array([only.duration_s]), smooth=True)
    if len(course.times_s) <= FEW:
        exact = ruckig_motion(task.start, course, task.limits, task.names)
        passes_s = np.array([*(exact.others_from_s + other.start_s for other in exact.others), exact.duration_s])
        if not stretched(exact):
            return PathPlan(task, exact, passes_s, smooth=True)
    smooth = smooth_path(task.start, course, task.limits, task.names)
    if exact is not None and exact.duration_s <= smooth.duration_s:
        return PathPlan(task, exact, passes_s, smooth=True)
    later = _passes(smooth.spline) + sum(smooth.windows_s) / 2.0
    later[-1] = smooth.duration_s
    return PathPlan(task, smooth, later, smooth=True)


def _passes(path: SplinePath) -> FloatArray:
    return np.array([*path.starts_s[1:], path.duration_s])


@dataclass(frozen=True, slots=True)
class StepPlan:
    """No interpolation: leaps, which the safety gate turns into ways at the velocity limit."""

    course: Course

    def join(self, reference: Kinematics, waited_s: float) -> Path:
        """It stands at the reference until the first point's time."""
        times_s = tuple((self.course.times_s - waited_s).tolist())
        return StepPath(reference.position, times_s, self.course.position, max(times_s[-1], 0.0))


@dataclass(frozen=True, slots=True)
class StepPath:
    """The start until the first point's time, and from each point's time on the next one; ``positions`` (m, n)."""

    start: FloatArray
    times_s: tuple[float, ...]
    positions: FloatArray
    duration_s: float

    @property
    def asked_s(self) -> float:
        """It never takes longer."""
        return self.duration_s

    def sample(self, time_s: float) -> Kinematics:
        """What the joints are told ``time_s`` after the start."""
        if time_s < self.times_s[0]:
            return Kinematics.at_rest(self.start)
        index = min(bisect_right(self.times_s, time_s), len(self.times_s) - 1)
        return Kinematics.at_rest(self.positions[index])
