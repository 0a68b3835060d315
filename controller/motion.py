"""Plan jerk-limited motions for n joints with ruckig. Trajectories are computed once and then sampled by time.

Units are rad (m for a prismatic joint) and seconds. Arrays have shape (n,).
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Protocol

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Synchronization, Trajectory

from hal.gate import clipped
from hal.types import AT_LIMIT, FloatArray, JointLimits, beyond_range

_ROUNDING = 1e-6
"""Rounding tolerance for positions (rad, m) and times (s)."""
STRETCHED_S = 1e-3
"""Minimum excess over the requested duration at which a motion counts as stretched, in seconds."""


class MotionError(Exception):
    """No motion within the limits connects the start and the target."""


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Position, velocity and acceleration of all joints at one instant."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def at_rest(cls, position: FloatArray) -> "Kinematics":
        """Return the kinematics of joints that are at rest at a position."""
        return cls(position.copy(), np.zeros_like(position), np.zeros_like(position))


class Path(Protocol):
    """Positions of the joints as a function of time. Any thread may sample a path."""

    @property
    def duration_s(self) -> float: ...
    @property
    def asked_s(self) -> float:
        """Requested duration, in seconds. The path takes longer if the limits require it."""
        ...

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start.

        For earlier times, the start is returned. For later times, the end is returned, at rest.
        """
        ...


def stretched(path: Path) -> bool:
    """Return whether the limits made the path take longer than requested."""
    return path.duration_s > path.asked_s + STRETCHED_S


@dataclass(frozen=True, slots=True)
class RuckigMotion:
    """A path of consecutive ruckig trajectories. ``starts_s`` contains the start time of each trajectory."""

    trajectories: tuple[Trajectory, ...]
    starts_s: tuple[float, ...]
    asked_s: float

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory], asked_s: float) -> "RuckigMotion":
        """Join trajectories into one path that starts at time 0."""
        starts_s = accumulate((float(trajectory.duration) for trajectory in trajectories[:-1]), initial=0.0)
        return cls(tuple(trajectories), tuple(starts_s), asked_s)

    @property
    def duration_s(self) -> float:
        """Time from the start of the first trajectory to the end of the last one."""
        return self.starts_s[-1] + float(self.trajectories[-1].duration)

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start."""
        index = max(bisect_right(self.starts_s, time_s) - 1, 0)
        trajectory = self.trajectories[index]
        at_s = min(max(time_s - self.starts_s[index], 0.0), trajectory.duration)
        position, velocity, acceleration = trajectory.at_time(at_s)
        if time_s > self.duration_s:
            return Kinematics.at_rest(np.array(position))
        return Kinematics(np.array(position), np.array(velocity), np.array(acceleration))


def motion_to(
    start: Kinematics, target: Kinematics, limits: Sequence[JointLimits], asked_s: float, names: Sequence[str] = ()
) -> RuckigMotion:
    """Plan a single-segment motion from ``start`` to ``target``. Raises MotionError, as ``segment`` does."""
    return RuckigMotion.of([segment(start, target, limits, asked_s, names)], asked_s)


def plan_stop(start: Kinematics, limits: Sequence[JointLimits]) -> RuckigMotion:
    """Plan the fastest stop that the acceleration and jerk limits of each joint allow. Raises MotionError."""
    task = _task(start, limits)
    task.synchronization = Synchronization.No  # A joint that waited for the other joints would move further.
    task.control_interface = ControlInterface.Velocity
    task.target_velocity = [0.0] * len(limits)
    task.target_acceleration = [0.0] * len(limits)
    trajectory = _calculate(task, len(limits))
    return RuckigMotion.of([trajectory], trajectory.duration)


def segment(
    start: Kinematics,
    end: Kinematics,
    limits: Sequence[JointLimits],
    span_s: float,
    names: Sequence[str] = (),
) -> Trajectory:
    """Plan a ruckig trajectory from ``start`` to ``end`` that takes ``span_s``, or longer if the limits require it.

    Raises MotionError with the joint's name from ``names``, or with its number if no names are given.
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
    """Check the position limits, which ruckig ignores. A joint that passes through a point too fast can exceed its
    limits."""
    lower, upper = swing_limits(start, limits)
    for index, (swing, limit) in enumerate(zip(trajectory.position_extrema, limits, strict=True)):
        for reached in (swing.min, swing.max):
            if not lower[index] <= reached <= upper[index]:
                position, low, high = beyond_range(reached, limit.lower, limit.upper)
                raise MotionError(
                    f"{names[index] if names else f'joint {index + 1}'} would swing to {position}, outside its "
                    f"limits {low} to {high}: reduce the speed at the points near this limit"
                )


def within_reach(wanted: FloatArray, last: FloatArray, velocity: FloatArray, period_s: float) -> FloatArray:
    """Return the positions (n,) nearest to ``wanted`` that joints at the positions ``last`` can reach in one period.

    ``velocity`` contains the joints' velocity limits (n,). The safety gate applies the same limits and therefore does
    not change the result.
    """
    reach = velocity * period_s
    return clipped(wanted, last - reach, last + reach)


def swing_limits(start: FloatArray, limits: Sequence[JointLimits]) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper positions (n,) between which a path may be planned.

    The range extends slightly beyond the limits, because an overshoot that the encoder can hardly resolve must not make
    a path invalid. A joint that starts outside its limits may return to them. The sampler keeps the commands within the
    limits.
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
    except (RuckigError, ValueError) as error:  # ruckig raises ValueError for some errors, such as NaN.
        raise MotionError(f"cannot find a motion within the limits: {' '.join(str(error).split())}") from error
    if result not in (Result.Working, Result.Finished):
        raise MotionError(f"cannot find a motion within the limits ({result.name})")
    return trajectory
