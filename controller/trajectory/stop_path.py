"""Stop paths bring a trajectory's joints to rest within the limits."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.motion import Kinematics, MotionError, Path, plan_stop
from hal.types import FloatArray, JointLimits

LOG = logging.getLogger("servoloop.controller")


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


def gentle_limits(
    joints: Sequence[str], limits: Sequence[JointLimits], decelerations: Mapping[str, float]
) -> list[JointLimits]:
    """``max_deceleration_on_cancel`` (0: none) can ask for a gentler stop, not for a harder one."""
    asked = [decelerations.get(name, 0.0) for name in joints]
    pairs = zip(limits, asked, strict=True)
    return [replace(limit, acceleration=min(limit.acceleration, a or math.inf)) for limit, a in pairs]
