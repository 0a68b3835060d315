"""Stop paths bring a trajectory's joints to rest within the limits: along their path, or each joint for itself."""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.motion import Kinematics, Motion, MotionError, Path, plan_stop
from controller.trajectory.parameters import TrajectoryParameters
from hal.types import FloatArray, JointLimits

LOG = logging.getLogger("servoloop.controller")

SHARES: Final = tuple(0.7**n for n in range(10))
"""The shares of acceleration and jerk that are tried for a stop on a path, which needs some for itself."""
LOOKS: Final = 40
"""At so many instants of a stop its accelerations are held against the limits."""
SLACK: Final = 1.001
"""How much more than a limit may be seen: paths are planned up to their limits."""


@dataclass(frozen=True, slots=True)
class Bounded:
    """A path that stops dead where it would leave ``lower`` to ``upper`` (n,)."""

    path: Path
    lower: FloatArray
    upper: FloatArray

    @property
    def duration_s(self) -> float:
        """The path's duration."""
        return self.path.duration_s

    @property
    def asked_s(self) -> float:
        """The path's asked duration."""
        return self.path.asked_s

    def sample(self, time_s: float) -> Kinematics:
        """The joints' movement ``time_s`` after the start."""
        state = self.path.sample(time_s)
        inside = np.clip(state.position, self.lower, self.upper)
        free = inside == state.position
        return Kinematics(inside, state.velocity * free, state.acceleration * free)


@dataclass(frozen=True, slots=True)
class Slowing:
    """A path on which time comes to a stop; ``progress`` is a motion of one joint, the path's own time."""

    path: Path
    progress: Motion

    @property
    def duration_s(self) -> float:
        """Until the joints stand still."""
        return self.progress.duration_s

    @property
    def asked_s(self) -> float:
        """The same: nobody asked for a duration."""
        return self.progress.duration_s

    def sample(self, time_s: float) -> Kinematics:
        """The joints' movement ``time_s`` after the start."""
        now = self.progress.sample(time_s)
        (at_s,), (rate,), (change,) = now.position, now.velocity, now.acceleration
        state = self.path.sample(at_s)
        acceleration: FloatArray = state.acceleration * rate**2 + state.velocity * change
        return Kinematics(state.position, state.velocity * rate, acceleration)


def stop_along(path: Path, elapsed_s: float, rate: float, limits: Sequence[JointLimits]) -> Path | None:
    """The quickest stop on the path from where the joints are, at ``elapsed_s`` with time passing ``rate`` times.

    The path itself where that ends sooner; None where it leaves no room to brake within the limits.
    """
    here = path.sample(elapsed_s)
    speed = np.maximum(np.abs(here.velocity), 1e-6)
    acceleration = min(limit.acceleration / v for limit, v in zip(limits, speed, strict=True))
    jerk = min(limit.jerk / v for limit, v in zip(limits, speed, strict=True))
    start = Kinematics(np.array([elapsed_s]), np.array([rate]), np.zeros(1))
    for share in SHARES:
        bound = JointLimits(-math.inf, math.inf, max(rate, 1.0), acceleration * share, jerk * share)
        slowing = Slowing(path, plan_stop(start, [bound]))
        if slowing.progress.sample(slowing.duration_s).position[0] >= path.duration_s:
            return path
        if _fits(slowing, rate, limits):
            return slowing
    return None


def _fits(slowing: Slowing, rate: float, limits: Sequence[JointLimits]) -> bool:
    """Whether braking accelerates no joint beyond its limit, or beyond what the path does anyway.

    Jerk has its limit twice, in the path and in the braking: where both are at it, nothing could be braked at once.
    """
    times_s = np.linspace(0.0, slowing.duration_s, LOOKS)
    braked = np.array([slowing.sample(time_s).acceleration for time_s in times_s])
    on_path_s = [slowing.progress.sample(time_s).position[0] for time_s in times_s]
    own = np.array([slowing.path.sample(at_s).acceleration for at_s in on_path_s]) * rate**2
    most = np.maximum([limit.acceleration for limit in limits], np.abs(own).max(axis=0))
    return bool((np.abs(braked) <= SLACK * most).all())


def stop_path(reference: Kinematics, limits: Sequence[JointLimits], gentle: Sequence[JointLimits]) -> Path:
    """A gentle stop; where that, or any stop (splines have no acceleration limit), ends outside, the limit ends it."""
    lower = np.array([limit.lower for limit in limits])
    upper = np.array([limit.upper for limit in limits])
    try:
        for path in (plan_stop(reference, gentle), plan_stop(reference, limits)):
            end = path.sample(path.duration_s).position
            if ((end >= lower) & (end <= upper)).all():
                return path
        return Bounded(path, lower, upper)
    except MotionError as error:
        LOG.error("no way to a stop, holding at once: %s", error)
        return plan_stop(Kinematics.at_rest(reference.position), limits)


def gentle_limits(limits: Sequence[JointLimits], parameters: TrajectoryParameters) -> list[JointLimits]:
    """``max_deceleration_on_cancel`` (0: none) can ask for a gentler stop, not for a harder one."""
    by_joint = parameters.constraints.by_joint()
    asked = [by_joint[name].max_deceleration_on_cancel for name in parameters.joints]
    pairs = zip(limits, asked, strict=True)
    return [replace(limit, acceleration=min(limit.acceleration, a or math.inf)) for limit, a in pairs]
