"""Jerk-limited motions for n joints, by ruckig: offline trajectories that are sampled by time.

Units: rad (m for a prismatic joint) and seconds; arrays have shape (n,).
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Synchronization, Trajectory

from hal.types import FloatArray, JointLimits

_ROUNDING = 1e-6
"""Of positions (rad, m) and times (s)."""
STRETCHED_S = 1e-3
"""So much longer than asked is said."""


class MotionError(Exception):
    """There is no motion from here to there within the limits."""


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Position, velocity and acceleration of all joints at one instant."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def at_rest(cls, position: FloatArray) -> "Kinematics":
        """Standing still."""
        return cls(position.copy(), np.zeros_like(position), np.zeros_like(position))


class Path(Protocol):
    """Where the joints are when. It can be sampled from any thread."""

    @property
    def duration_s(self) -> float: ...
    @property
    def asked_s(self) -> float:
        """The duration that was asked for; it takes longer where the limits forbid it."""
        ...

    def sample(self, time_s: float) -> Kinematics:
        """``time_s`` after the start; before it the start, after the end the end at rest."""
        ...


def stretched(path: Path) -> bool:
    """Whether the limits made it longer than asked."""
    return path.duration_s > path.asked_s + STRETCHED_S


@dataclass(frozen=True, slots=True)
class WayPoint:
    """Pass through ``state`` ``time_s`` after the motion's start, or later where limits forbid it."""

    state: Kinematics
    time_s: float


@dataclass(frozen=True, slots=True)
class Segment:
    """One ruckig trajectory and when it begins, in seconds."""

    trajectory: Trajectory
    start_s: float


@dataclass(frozen=True, slots=True)
class Motion:
    """A first segment, and segments end to end behind it: a path."""

    first: Trajectory
    asked_s: float
    others: tuple[Segment, ...] = ()
    """They begin ``others_from_s`` after what they say: so they can be shared by motions that begin elsewhere."""
    others_from_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Until the last segment's end."""
        if not self.others:
            return float(self.first.duration)
        return self.others_from_s + self.others[-1].start_s + float(self.others[-1].trajectory.duration)

    def sample(self, time_s: float) -> Kinematics:
        """Where the joints are ``time_s`` after the start."""
        trajectory, at_s = self.first, max(0.0, time_s)
        if self.others and at_s >= self.first.duration:
            at_s -= self.others_from_s
            index = max(bisect_right(self.others, at_s, key=lambda segment: segment.start_s) - 1, 0)
            trajectory, at_s = self.others[index].trajectory, at_s - self.others[index].start_s
        position, velocity, acceleration = trajectory.at_time(min(max(at_s, 0.0), trajectory.duration))
        if time_s > self.duration_s:
            return Kinematics.at_rest(np.array(position))
        return Kinematics(np.array(position), np.array(velocity), np.array(acceleration))


def plan(start: Kinematics, points: Sequence[WayPoint], limits: Sequence[JointLimits]) -> Motion:
    """From ``start`` through every point, segment by segment. Raises MotionError."""
    trajectories: list[Trajectory] = []
    before_s = 0.0
    for point in points:
        trajectories.append(segment(start, point.state, limits, max(point.time_s - before_s, 0.0)))
        before_s, start = point.time_s, point.state
    asked_s = max(points[-1].time_s, 0.0)
    return Motion(trajectories[0], asked_s, end_to_end(trajectories[1:]), trajectories[0].duration)


def end_to_end(trajectories: Sequence[Trajectory]) -> tuple[Segment, ...]:
    """One after the other, the first at 0."""
    elapsed_s, segments = 0.0, list[Segment]()
    for trajectory in trajectories:
        segments.append(Segment(trajectory, elapsed_s))
        elapsed_s += trajectory.duration
    return tuple(segments)


def plan_stop(start: Kinematics, limits: Sequence[JointLimits]) -> Motion:
    """Come to rest as soon as acceleration and jerk allow, each joint wherever that is. Raises MotionError."""
    task = _task(start, limits)
    task.synchronization = Synchronization.No  # a joint that waited for the others would go further
    task.control_interface = ControlInterface.Velocity
    task.target_velocity = [0.0] * len(limits)
    task.target_acceleration = [0.0] * len(limits)
    trajectory = _calculate(task, len(limits))
    return Motion(trajectory, trajectory.duration)


def segment(
    start: Kinematics,
    end: Kinematics,
    limits: Sequence[JointLimits],
    span_s: float,
    names: Sequence[str] = (),
) -> Trajectory:
    """From one state to the other in ``span_s`` or, where that is too short, as fast as the limits allow.

    Raises MotionError, calling the joints by ``names`` where there are some.
    """
    task = _task(start, limits)
    task.target_position = list(end.position)
    task.target_velocity = list(end.velocity)
    task.target_acceleration = list(end.acceleration)
    if span_s > _ROUNDING:
        task.minimum_duration = span_s
    trajectory = _calculate(task, len(limits))
    _check_positions(trajectory, start.position, limits, names)
    return trajectory


def _check_positions(
    trajectory: Trajectory, start: FloatArray, limits: Sequence[JointLimits], names: Sequence[str]
) -> None:
    """Ruckig knows no position limits: a way-point passed too fast near one would swing beyond it.

    A joint that stands outside may come back in.
    """
    for index, (swing, limit) in enumerate(zip(trajectory.position_extrema, limits, strict=True)):
        lower, upper = min(limit.lower, start[index]), max(limit.upper, start[index])
        for reached in (swing.min, swing.max):
            if not lower - _ROUNDING <= reached <= upper + _ROUNDING:
                raise MotionError(
                    f"{names[index] if names else f'joint {index + 1}'} would swing to {reached:.4f}, outside its "
                    f"limits {limit.lower:.4f} to {limit.upper:.4f}: pass the points near it slower"
                )


def _task(start: Kinematics, limits: Sequence[JointLimits]) -> InputParameter:
    task = InputParameter(len(limits))
    task.current_position = list(start.position)
    task.current_velocity = list(start.velocity)
    task.current_acceleration = list(start.acceleration)
    task.max_velocity = [limit.velocity for limit in limits]
    task.max_acceleration = [limit.acceleration for limit in limits]
    task.max_jerk = [limit.jerk for limit in limits]
    return task


def _calculate(task: InputParameter, dofs: int) -> Trajectory:
    trajectory = Trajectory(dofs)
    try:
        result = Ruckig(dofs).calculate(task, trajectory)
    except RuckigError as error:  # ruckig refuses targets beyond the limits, NaN and the like
        raise MotionError(f"no motion within the limits: {' '.join(str(error).split())}") from error
    if result not in (Result.Working, Result.Finished):
        raise MotionError(f"no motion within the limits ({result.name})")
    return trajectory
