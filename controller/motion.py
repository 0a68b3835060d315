"""Jerk-limited motions for n joints, by ruckig: offline trajectories that are sampled by time.

Units: rad (m for a prismatic joint) and seconds; arrays have shape (n,).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Trajectory

from hal.types import FloatArray, JointLimits

_ROUNDING = 1e-6
"""Of positions (rad, m) and times (s)."""


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


@dataclass(frozen=True, slots=True)
class WayPoint:
    """Pass through ``state`` ``time_s`` after the motion's start, or later where limits forbid it."""

    state: Kinematics
    time_s: float


@dataclass(frozen=True, slots=True)
class Segment:
    """One ruckig trajectory and when it begins, in seconds after the motion's start."""

    trajectory: Trajectory
    start_s: float


@dataclass(frozen=True, slots=True)
class Motion:
    """Segments end to end. Before its start it gives the start, after its end the end at rest."""

    segments: tuple[Segment, ...]
    duration_s: float
    asked_s: float
    """The duration that was asked for; the motion takes longer where the limits forbid it."""

    @property
    def stretched(self) -> bool:
        """Whether the limits made it longer than asked."""
        return self.duration_s > self.asked_s + 1e-3

    def sample(self, time_s: float) -> Kinematics:
        """Where the joints are ``time_s`` after the start."""
        time_s = max(0.0, time_s)
        segment = self.segments[0]
        for later in self.segments[1:]:
            if time_s < later.start_s:
                break
            segment = later
        at_s = min(time_s - segment.start_s, segment.trajectory.duration)
        position, velocity, acceleration = segment.trajectory.at_time(at_s)
        if time_s > self.duration_s:
            return Kinematics.at_rest(np.array(position))
        return Kinematics(np.array(position), np.array(velocity), np.array(acceleration))


def plan(start: Kinematics, points: Sequence[WayPoint], limits: Sequence[JointLimits]) -> Motion:
    """From ``start`` through every point, segment by segment. Raises MotionError."""
    segments: list[Segment] = []
    elapsed_s, asked_before_s = 0.0, 0.0
    for point in points:
        span_s = max(point.time_s - asked_before_s, 0.0)
        trajectory = _segment(start, point.state, limits, span_s)
        segments.append(Segment(trajectory, elapsed_s))
        elapsed_s += trajectory.duration
        asked_before_s = point.time_s
        start = point.state
    return Motion(tuple(segments), elapsed_s, max(points[-1].time_s, 0.0))


def plan_stop(start: Kinematics, limits: Sequence[JointLimits]) -> Motion:
    """Come to rest as soon as acceleration and jerk allow, wherever that is."""
    task = _task(start, limits)
    task.control_interface = ControlInterface.Velocity
    task.target_velocity = [0.0] * len(limits)
    task.target_acceleration = [0.0] * len(limits)
    trajectory = _calculate(task, len(limits))
    return Motion((Segment(trajectory, 0.0),), trajectory.duration, trajectory.duration)


def _segment(start: Kinematics, end: Kinematics, limits: Sequence[JointLimits], span_s: float) -> Trajectory:
    task = _task(start, limits)
    task.target_position = list(end.position)
    task.target_velocity = list(end.velocity)
    task.target_acceleration = list(end.acceleration)
    if span_s > _ROUNDING:
        task.minimum_duration = span_s
    trajectory = _calculate(task, len(limits))
    _check_positions(trajectory, limits)
    return trajectory


def _check_positions(trajectory: Trajectory, limits: Sequence[JointLimits]) -> None:
    """Ruckig knows no position limits: a way-point passed too fast near one would swing beyond it."""
    for number, (swing, limit) in enumerate(zip(trajectory.position_extrema, limits, strict=True), start=1):
        for reached in (swing.min, swing.max):
            if not limit.lower - _ROUNDING <= reached <= limit.upper + _ROUNDING:
                raise MotionError(
                    f"joint {number} would swing to {reached:.4f}, outside its limits "
                    f"{limit.lower:.4f} to {limit.upper:.4f}"
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
