"""The trajectory sampler samples a path once a cycle: it knows the path, and how far along it the joints are to be."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import Kinematics, Path, plan_stop
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.speed_scaling import SpeedScaling, scaled
from controller.trajectory.stop_path import gentle_limits, stop_along, stop_path
from hal.types import AT_LIMIT, FloatArray, JointLimits


@dataclass(frozen=True, slots=True)
class Tracking:
    """One cycle as ``~/controller_state`` shows it; arrays (n,) in rad (m) and seconds."""

    stamp_s: float
    reference: Kinematics
    feedback_position: FloatArray
    feedback_velocity: FloatArray
    error: FloatArray
    """Of the position; the shorter way round for a joint without ends."""
    output: FloatArray
    """The command."""
    speed_scaling_factor: float
    path: Path
    elapsed_s: float
    """On the path."""
    on_goal: bool
    """Whether the path is a goal's, and not a stop or a hold."""
    rate: float
    """The rate at which time passes on the path."""

    def at(self, later_s: float) -> tuple[Kinematics, bool]:
        """The reference ``later_s`` (negative: ago) from this cycle, and whether a goal is under way then."""
        time_s = self.elapsed_s + later_s * self.rate
        return _moving(self.path, time_s, self.rate), self.on_goal and 0.0 <= time_s < self.path.duration_s


NO_LAG: Final = np.array([[0.0], [np.inf], [0.0]])


class TrajectorySampler:
    """The sampler follows one path at a time, at the speed that is asked for. In the loop's thread."""

    def __init__(self, limits: Sequence[JointLimits], scaling: float = 1.0, lags: FloatArray | None = None) -> None:
        """``lags``: how far joints lag behind commands (hal.compensation.servo_compliance); unless said, not at all."""
        self.scaling = SpeedScaling(limits, scaling)
        self.on_goal = False
        self.elapsed_s = 0.0
        self.path: Path | None = None
        self.rate = 1.0
        self.limits = tuple(limits)
        self._lag_s, self._braking, self._inertia_s2 = NO_LAG if lags is None else lags
        self.still = np.array([AT_LIMIT * min(limit.upper - limit.lower, math.tau) / 2.0 for limit in limits])
        """Joints (n,) that move by no more are at rest: two counts of an encoder."""

    def advance(self, step_s: float) -> Kinematics:
        """One cycle further; returns where the joints are to be now.

        The period that has passed was commanded at the former factor; a new one counts from here on.
        """
        assert self.path is not None, "activated before the first update"
        self.elapsed_s += step_s * self.rate
        if self.scaling.asked != self.scaling.factor:
            if self.on_goal:
                self.scaling.advance(self.path.sample(self.elapsed_s), step_s)
                self.rate = self.scaling.factor
            else:
                self.scaling.idle()
        return self.reference()

    def reference(self, later_s: float = 0.0) -> Kinematics:
        """The reference of now, or later: where the joints are to be, and how they are to move."""
        assert self.path is not None, "activated before the first update"
        return _moving(self.path, self.elapsed_s + later_s * self.rate, self.rate)

    def ahead(self, period_s: float, lead_s: float | None = None) -> FloatArray:
        """The command that brings joints to the reference at the cycle's end (n,): beyond it by as much as they lag.

        A servo brakes for each goal until the next one comes; in the middle of that it is as far behind as it must.
        ``lead_s``: a lag that is the same for all joints, instead of what is known of each.
        """
        if lead_s is not None:
            return self.inside(self.reference(period_s + lead_s).position)
        to = self.reference(period_s)
        brakes_from = np.maximum(np.abs(to.velocity) - self._braking * (period_s / 4.0), 0.0)
        behind = np.sign(to.velocity) * brakes_from**2 / (2.0 * self._braking)
        lag = self._lag_s * to.velocity + behind + self._inertia_s2 * to.acceleration
        return self.inside(to.position + lag)

    def follow(self, path: Path, reference: Kinematics, on_goal: bool = True) -> None:
        """Set out on another path, which begins at ``reference``."""
        self.path, self.elapsed_s, self.on_goal = path, 0.0, on_goal
        if self.scaling.asked != 1.0 or self.scaling.factor != 1.0:
            self.scaling.restart(bool(reference.velocity.any()))
        self.rate = self.scaling.factor if on_goal else 1.0

    def hold(self, position: FloatArray) -> None:
        """Stay there, or rather at the nearest place within the limits."""
        state = Kinematics.at_rest(self.inside(position))
        self.follow(plan_stop(state, self.limits), state, on_goal=False)

    def inside(self, position: FloatArray) -> FloatArray:
        """The nearest position (n,) within the limits."""
        lower, upper = [limit.lower for limit in self.limits], [limit.upper for limit in self.limits]
        inside: FloatArray = np.clip(position, lower, upper)
        return inside

    def stop(self, reference: Kinematics, parameters: TrajectoryParameters, along: bool = False) -> None:
        """Come to rest within the limits, and stay there; ``along`` the goal's path, if that leaves room."""
        gentle = gentle_limits(self.limits, parameters)
        path = self.path if along and self.on_goal else None
        on_path = stop_along(path, self.elapsed_s, self.rate, gentle) if path else None
        if on_path is None or on_path is not path:
            self.follow(on_path or stop_path(reference, self.limits, gentle), reference, on_goal=False)
        self.on_goal = False  # the path itself may end sooner than any stop on it

    @property
    def stands(self) -> bool:
        """Whether the path has come to its end."""
        return self.path is None or self.elapsed_s >= self.path.duration_s


def _moving(path: Path, time_s: float, rate: float) -> Kinematics:
    """The movement on a path where time passes ``rate`` times as fast."""
    state = path.sample(time_s)
    return state if rate == 1.0 else scaled(state, rate)


def shorter_way(error: FloatArray, endless: Sequence[int]) -> FloatArray:
    """An error (n,) where joints without ends (their indices) count the shorter way round."""
    if endless:
        columns = list(endless)
        error = error.copy()
        error[columns] = (error[columns] + math.pi) % math.tau - math.pi
    return error
