"""Where the joints are to be: the path that is followed, and how far along it they are."""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.motion import Kinematics, MotionError, Path, plan_stop
from controller.scaling import SpeedScaling, scaled
from controller.trajectory_parameters import TrajectoryParameters
from hal.types import FloatArray, JointLimits

LOG = logging.getLogger("servoloop.controller")


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
    """How fast time passes on the path."""

    def at(self, later_s: float) -> tuple[Kinematics, bool]:
        """The reference ``later_s`` (negative: ago) from this cycle, and whether a goal is under way then."""
        time_s = self.elapsed_s + later_s * self.rate
        state = scaled(self.path.sample(time_s), self.rate)
        return state, self.on_goal and 0.0 <= time_s < self.path.duration_s


@dataclass(frozen=True, slots=True)
class Bounded:
    """A path that stops dead where it would leave ``lower`` to ``upper`` (n,)."""

    path: Path
    lower: FloatArray
    upper: FloatArray

    @property
    def duration_s(self) -> float:
        """Of the path."""
        return self.path.duration_s

    @property
    def asked_s(self) -> float:
        """Of the path."""
        return self.path.asked_s

    def sample(self, time_s: float) -> Kinematics:
        """Where the joints are ``time_s`` after the start."""
        state = self.path.sample(time_s)
        inside = np.clip(state.position, self.lower, self.upper)
        free = inside == state.position
        return Kinematics(inside, state.velocity * free, state.acceleration * free)


class Follower:
    """Follows one path at a time, at the speed that is asked for. In the loop's thread."""

    def __init__(self, limits: Sequence[JointLimits], initial_scaling: float = 1.0) -> None:
        self.scaling = SpeedScaling(limits, initial_scaling)
        self.on_goal = False
        self.elapsed_s = 0.0
        self.path: Path | None = None
        self._limits = tuple(limits)
        self._lower = np.array([limit.lower for limit in limits])
        self._upper = np.array([limit.upper for limit in limits])
        self._rate = 1.0

    def advance(self, step_s: float) -> Kinematics:
        """One cycle further; returns where the joints are to be now.

        The period that has passed was commanded at the former factor; a new one counts from here on.
        """
        self.elapsed_s += step_s * self._rate
        if not self.on_goal:
            self.scaling.idle()
        elif self.scaling.changes:
            self.scaling.advance(self._path_state(), step_s)
            self._rate = self.scaling.factor
        return self.reference()

    def reference(self) -> Kinematics:
        """Where the joints are to be, and how they move, now."""
        return scaled(self._path_state(), self._rate)

    def ahead(self, time_s: float) -> FloatArray:
        """Where they are to be so much later (n,)."""
        assert self.path is not None, "activated before the first update"
        return self.path.sample(self.elapsed_s + time_s * self._rate).position

    def tracking(
        self,
        stamp_s: float,
        reference: Kinematics,
        position: FloatArray,
        velocity: FloatArray,
        error: FloatArray,
        output: FloatArray,
    ) -> Tracking:
        """What others may see of this cycle; ``position`` and ``velocity`` were measured."""
        assert self.path is not None, "activated before the first update"
        speed = self.scaling.factor
        return Tracking(
            stamp_s,
            reference,
            position,
            velocity,
            error,
            output,
            speed,
            self.path,
            self.elapsed_s,
            self.on_goal,
            self._rate,
        )

    def follow(self, path: Path, reference: Kinematics, on_goal: bool = True) -> None:
        """Set out on another path, which begins at ``reference``."""
        self.path, self.elapsed_s, self.on_goal = path, 0.0, on_goal
        self.scaling.restart(bool(reference.velocity.any()))
        self._rate = self.scaling.factor if on_goal else 1.0

    def hold(self, position: FloatArray) -> None:
        """Stay there, or rather at the nearest place within the limits."""
        state = Kinematics.at_rest(np.clip(position, self._lower, self._upper))
        self.follow(plan_stop(state, self._limits), state, on_goal=False)

    def stop(self, reference: Kinematics, parameters: TrajectoryParameters) -> None:
        """Come to rest within the limits, and stay there."""
        path = self._stop_path(reference, _stop_limits(self._limits, parameters))
        self.follow(path, reference, on_goal=False)

    def _stop_path(self, reference: Kinematics, gentle: Sequence[JointLimits]) -> Path:
        """Where a gentle stop, or any (splines know no acceleration limit), would end outside, the limit ends it."""
        try:
            for path in (plan_stop(reference, gentle), plan_stop(reference, self._limits)):
                end = path.sample(path.duration_s).position
                if ((end >= self._lower) & (end <= self._upper)).all():
                    return path
            return Bounded(path, self._lower, self._upper)
        except MotionError as error:
            LOG.error("no way to a stop, holding at once: %s", error)
            return plan_stop(Kinematics.at_rest(reference.position), self._limits)

    def _path_state(self) -> Kinematics:
        assert self.path is not None, "activated before the first update"
        return self.path.sample(self.elapsed_s)


def _stop_limits(limits: Sequence[JointLimits], parameters: TrajectoryParameters) -> list[JointLimits]:
    """``max_deceleration_on_cancel`` can ask for a gentler stop, not for a harder one."""
    by_joint = parameters.constraints.by_joint()
    asked = [by_joint[name].max_deceleration_on_cancel if name in by_joint else 0.0 for name in parameters.joints]
    pairs = zip(limits, asked, strict=True)
    return [replace(limit, acceleration=min(limit.acceleration, a or math.inf)) for limit, a in pairs]


def shorter_way(error: FloatArray, endless: Sequence[int]) -> FloatArray:
    """An error (n,) where joints without ends (their indices) count the shorter way round."""
    if endless:
        columns = list(endless)
        error = error.copy()
        error[columns] = (error[columns] + math.pi) % math.tau - math.pi
    return error
