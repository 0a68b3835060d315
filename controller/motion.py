"""Jerk-limited motions for n joints, by ruckig: offline trajectories that are sampled by time.

Units: rad (m for a prismatic joint) and seconds; arrays have shape (n,).
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Protocol

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Synchronization, Trajectory

from hal.types import AT_LIMIT, FloatArray, JointLimits, beyond_range

_ROUNDING = 1e-6
"""The rounding of positions (rad, m) and times (s)."""
STRETCHED_S = 1e-3
"""From so much longer than asked on, a motion counts as stretched."""


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
    """A path says where the joints are when. Any thread may sample a path."""

    @property
    def duration_s(self) -> float: ...
    @property
    def asked_s(self) -> float:
        """The duration that was asked for; the path takes longer where the limits forbid it."""
        ...

    def sample(self, time_s: float) -> Kinematics:
        """``time_s`` after the start; before it the start, after the end the end at rest."""
        ...


def stretched(path: Path) -> bool:
    """Whether the limits made the path longer than asked."""
    return path.duration_s > path.asked_s + STRETCHED_S


@dataclass(frozen=True, slots=True)
class Motion:
    """Ruckig's trajectories end to end, as a path; ``starts_s`` says when each of them begins."""

    trajectories: tuple[Trajectory, ...]
    starts_s: tuple[float, ...]
    asked_s: float

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory], asked_s: float) -> "Motion":
        """One trajectory after the other, the first at 0."""
        starts_s = accumulate((float(trajectory.duration) for trajectory in trajectories[:-1]), initial=0.0)
        return cls(tuple(trajectories), tuple(starts_s), asked_s)

    @property
    def duration_s(self) -> float:
        """Until the last trajectory's end."""
        return self.starts_s[-1] + float(self.trajectories[-1].duration)

    def sample(self, time_s: float) -> Kinematics:
        """The joints' movement ``time_s`` after the start."""
        index = max(bisect_right(self.starts_s, time_s) - 1, 0)
        trajectory = self.trajectories[index]
        at_s = min(max(time_s - self.starts_s[index], 0.0), trajectory.duration)
        position, velocity, acceleration = trajectory.at_time(at_s)
        if time_s > self.duration_s:
            return Kinematics.at_rest(np.array(position))
        return Kinematics(np.array(position), np.array(velocity), np.array(acceleration))


def motion_to(
    start: Kinematics, target: Kinematics, limits: Sequence[JointLimits], asked_s: float, names: Sequence[str] = ()
) -> Motion:
    """One segment from ``start`` to ``target``. Raises MotionError as ``segment`` does."""
    return Motion.of([segment(start, target, limits, asked_s, names)], asked_s)


def plan_stop(start: Kinematics, limits: Sequence[JointLimits]) -> Motion:
    """Come to rest as soon as acceleration and jerk allow, each joint wherever that is. Raises MotionError."""
    task = _task(start, limits)
    task.synchronization = Synchronization.No  # a joint that waited for the others would go further
    task.control_interface = ControlInterface.Velocity
    task.target_velocity = [0.0] * len(limits)
    task.target_acceleration = [0.0] * len(limits)
    trajectory = _calculate(task, len(limits))
    return Motion.of([trajectory], trajectory.duration)


def segment(
    start: Kinematics,
    end: Kinematics,
    limits: Sequence[JointLimits],
    span_s: float,
    names: Sequence[str] = (),
) -> Trajectory:
    """Ruckig's way from one state to the other in ``span_s`` or, where that is too short, as fast as the limits allow.

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
    """Ruckig has no position limits: a waypoint passed too fast near a limit would swing beyond it."""
    lower, upper = swing_limits(start, limits)
    for index, (swing, limit) in enumerate(zip(trajectory.position_extrema, limits, strict=True)):
        for reached in (swing.min, swing.max):
            if not lower[index] <= reached <= upper[index]:
                said, low, high = beyond_range(reached, limit.lower, limit.upper)
                raise MotionError(
                    f"{names[index] if names else f'joint {index + 1}'} would swing to {said}, outside its "
                    f"limits {low} to {high}: pass the points near it slower"
                )


def within_reach(wanted: FloatArray, last: FloatArray, velocity: FloatArray, period_s: float) -> FloatArray:
    """Return the positions (n,) nearest to ``wanted`` that joints at ``last`` reach in one period.

    ``velocity``: the joints' velocity limits (n,). The safety gate applies the same limit, and changes nothing further.
    """
    reach = velocity * period_s
    reached: FloatArray = np.clip(wanted, last - reach, last + reach)
    return reached


def swing_limits(start: FloatArray, limits: Sequence[JointLimits]) -> tuple[FloatArray, FloatArray]:
    """Return the positions (n,) between which a path may be planned; the sampler holds commands within the limits.

    A swing that an encoder hardly resolves is no reason to refuse a path. A joint that stands outside may come back in.
    """
    ends = [(limit.lower, limit.upper, AT_LIMIT * (limit.upper - limit.lower) + _ROUNDING) for limit in limits]
    lower, upper, slack = np.array(ends).T
    return np.minimum(lower - slack, start - _ROUNDING), np.maximum(upper + slack, start + _ROUNDING)


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
    except (RuckigError, ValueError) as error:  # NaN, targets beyond the limits; for some errors ruckig has no name
        raise MotionError(f"no motion within the limits: {' '.join(str(error).split())}") from error
    if result not in (Result.Working, Result.Finished):
        raise MotionError(f"no motion within the limits ({result.name})")
    return trajectory
