"""Sample a path once per cycle, at the requested speed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from controller.motion import Kinematics, Path, plan_stop
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.speed_scaling import SpeedScaling, scaled
from controller.trajectory.stop_path import gentle_limits, stop_along, stop_path
from hal.gate import clipped
from hal.types import AT_LIMIT, FloatArray, JointLimits


@dataclass(frozen=True, slots=True)
class Tracking:
    """Data of one cycle for ``~/controller_state``. Arrays have shape (n,), in rad (m) and seconds."""

    stamp_s: float
    reference: Kinematics
    feedback_position: FloatArray
    feedback_velocity: FloatArray
    error: FloatArray
    """Position error. For a continuous joint, this is the error in the shorter direction."""
    output: FloatArray
    """Command."""
    speed_scaling_factor: float
    path: Path
    elapsed_s: float
    """Time on the path, in seconds."""
    on_goal: bool
    """Whether the path belongs to a goal, rather than to a stop or a held position."""
    rate: float
    """Rate at which time passes on the path."""

    def at(self, later_s: float) -> tuple[Kinematics, bool]:
        """Return the reference ``later_s`` after this cycle, and whether a goal is active at that time.

        If ``later_s`` is negative, the time is earlier than this cycle.
        """
        time_s = self.elapsed_s + later_s * self.rate
        return _moving(self.path, time_s, self.rate), self.on_goal and 0.0 <= time_s < self.path.duration_s


class _Lag(NamedTuple):
    """Lag of one joint (see hal.compensation.servo_compliance)."""

    lag_s: float
    braking: float
    """Profile acceleration, at which the servo brakes for each goal, in rad/s² or m/s²."""
    inertia_s2: float


NO_LAG: Final = _Lag(0.0, math.inf, 0.0)


class TrajectorySampler:
    """Sampler that runs in the loop thread and follows one path at a time, at the requested speed."""

    def __init__(self, limits: Sequence[JointLimits], scaling: float = 1.0, lags: FloatArray | None = None) -> None:
        """Create a sampler. ``lags`` come from hal.compensation.servo_compliance; None means no lag."""
        self.scaling = SpeedScaling(limits, scaling)
        self.on_goal = False
        self.elapsed_s = 0.0
        self.path: Path | None = None
        self._end: Kinematics | None = None
        """Kinematics at the end of the path, or None if the path has not ended. They are cached, because an arm is at
        rest in most cycles."""
        self.rate = 1.0
        self.limits = tuple(limits)
        self._lower, self._upper = (np.array([getattr(limit, end) for limit in limits]) for end in ("lower", "upper"))
        self._lags = [NO_LAG] * len(limits) if lags is None else [_Lag(*lag) for lag in lags.T.tolist()]
        self._ends = [(limit.lower, limit.upper) for limit in limits]
        self.still = np.array([AT_LIMIT * min(limit.upper - limit.lower, math.tau) / 2.0 for limit in limits])
        """Still threshold (n,): the largest change of position that does not count as motion (two encoder counts)."""

    def advance(self, step_s: float) -> Kinematics:
        """Advance the path by one cycle and return the current reference.

        The commands of the elapsed period used the previous scaling factor. A new factor applies from now on.
        """
        assert self.path is not None, "the controller is updated before it is activated"
        self.elapsed_s += step_s * self.rate
        if self.scaling.asked != self.scaling.factor:
            if self.on_goal:
                self.scaling.advance(self.path.sample(self.elapsed_s), step_s)
                self.rate = self.scaling.factor
            else:
                self.scaling.idle()
        return self.reference()

    def reference(self, later_s: float = 0.0) -> Kinematics:
        """Return the reference now, or ``later_s`` from now."""
        if self._end is not None:
            return self._end
        assert self.path is not None, "the controller is updated before it is activated"
        reference = _moving(self.path, self.elapsed_s + later_s * self.rate, self.rate)
        if self.elapsed_s > self.path.duration_s:
            self._end = reference
        return reference

    def ahead(self, period_s: float, lead_s: float | None = None) -> FloatArray:
        """Return the command (n,) that brings the joints to the reference by the end of the cycle.

        The command leads the reference by the lag of each joint. Until the next goal arrives, a servo brakes as it
        approaches its current goal. The lag takes half of this braking into account. ``lead_s`` replaces the known lags
        with one value for all joints.
        """
        if lead_s is not None or self._end is not None:
            return self.inside(self.reference(period_s + (lead_s or 0.0)).position)
        to = self.reference(period_s)
        places = zip(
            *(to.position.tolist(), to.velocity.tolist(), to.acceleration.tolist(), self._lags, self._ends), strict=True
        )
        return np.array([_led(*place, period_s) for place in places])

    def follow(self, path: Path, reference: Kinematics, on_goal: bool = True) -> None:
        """Follow another path, which starts at ``reference``."""
        self.path, self.elapsed_s, self.on_goal, self._end = path, 0.0, on_goal, None
        if self.scaling.asked != 1.0 or self.scaling.factor != 1.0:
            self.scaling.restart(bool(reference.velocity.any()))
        self.rate = self.scaling.factor if on_goal else 1.0

    def resume(self, path: Path, from_s: float) -> None:
        """Follow a path from rest, starting ``from_s`` after the start of the path."""
        self.path, self.elapsed_s, self._end = path, from_s, None
        self.scaling.factor = self.rate = 0.0

    def hold(self, position: FloatArray) -> None:
        """Hold a position (n,), or the nearest position within the limits."""
        state = Kinematics.at_rest(self.inside(position))
        self.follow(plan_stop(state, self.limits), state, on_goal=False)

    def inside(self, position: FloatArray) -> FloatArray:
        """Return the nearest position (n,) within the limits."""
        return clipped(position, self._lower, self._upper)

    def stop(self, reference: Kinematics, parameters: TrajectoryParameters, along: bool = False) -> None:
        """Stop within the limits and hold the position. If ``along`` is True, stop on the goal's path if possible."""
        gentle = gentle_limits(self.limits, parameters)
        path = self.path if along and self.on_goal else None
        on_path = stop_along(path, self.elapsed_s, self.rate, gentle) if path else None
        if on_path is None or on_path is not path:
            self.follow(on_path or stop_path(reference, self.limits, gentle), reference, on_goal=False)
        self.on_goal = False  # The goal's path may continue, if it ends about as soon as a stop would.

    @property
    def ended(self) -> bool:
        """Whether the path has ended."""
        return self.path is None or self.elapsed_s >= self.path.duration_s


def _led(
    position: float, velocity: float, acceleration: float, lag: _Lag, ends: tuple[float, float], period_s: float
) -> float:
    """Return a joint's command, which leads the reference by the joint's lag. Plain floats are faster than arrays."""
    brakes_from = max(abs(velocity) - lag.braking * (period_s / 4.0), 0.0)
    braking_lag = math.copysign(brakes_from * brakes_from / (2.0 * lag.braking), velocity)
    led = position + (lag.lag_s * velocity + braking_lag + lag.inertia_s2 * acceleration)
    return min(max(led, ends[0]), ends[1])


def _moving(path: Path, time_s: float, rate: float) -> Kinematics:
    """Return the kinematics of a path on which time passes at ``rate``."""
    state = path.sample(time_s)
    return state if rate == 1.0 else scaled(state, rate)


def shorter_way(error: FloatArray, endless: Sequence[int]) -> FloatArray:
    """Return a position error (n,), measured in the shorter direction for continuous joints (indices ``endless``)."""
    if endless:
        columns = list(endless)
        error = error.copy()
        error[columns] = (error[columns] + math.pi) % math.tau - math.pi
    return error
