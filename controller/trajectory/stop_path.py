"""Stop paths bring a trajectory's joints to rest within the limits: along their path, or each joint for itself."""

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.motion import Kinematics, Motion, MotionError, Path, plan_stop
from controller.trajectory.parameters import TrajectoryParameters
from hal.types import FloatArray, JointLimits

LOG = logging.getLogger("servoloop.controller")

SHARES: Final = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Shares of the acceleration and jerk limits that are tried for a stop on a path, which needs some for itself."""
DELAYS_S: Final = (0.0, 0.05, 0.1, 0.15, 0.2)
"""Times after which such a stop may begin: a path that brakes a joint with all it has leaves nothing for the stop."""
LONGEST_STOP: Final = 2.0
"""A stop on a path may take so many times as long as one that has the limits for itself, and ``STOP_MARGIN_S`` more."""
STOP_MARGIN_S: Final = 0.2
TRIES: Final = 12
"""Number of stops, the quickest first, whose accelerations are compared with the limits: the loop's thread waits."""
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
    """A path on which time comes to a stop; ``progress`` is a motion of one joint, the path's own time.

    Until ``delay_s`` time goes on as it did, at ``rate``.
    """

    path: Path
    progress: Motion
    rate: float = 1.0
    delay_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Until the joints stand still."""
        return self.delay_s + self.progress.duration_s

    @property
    def asked_s(self) -> float:
        """The same: no client asked for a duration."""
        return self.duration_s

    def on_path(self, time_s: float) -> tuple[float, float, float]:
        """The path's own time ``time_s`` after the start (s), how fast it passes, and how that changes (1/s)."""
        later_s = time_s - self.delay_s
        now = self.progress.sample(later_s)
        if later_s < 0.0:
            return float(now.position[0]) + self.rate * later_s, self.rate, 0.0
        return float(now.position[0]), float(now.velocity[0]), float(now.acceleration[0])

    def sample(self, time_s: float) -> Kinematics:
        """The joints' movement ``time_s`` after the start."""
        at_s, rate, change = self.on_path(time_s)
        state = self.path.sample(at_s)
        acceleration: FloatArray = state.acceleration * rate**2 + state.velocity * change
        return Kinematics(state.position, state.velocity * rate, acceleration)


def stop_along(path: Path, elapsed_s: float, rate: float, limits: Sequence[JointLimits]) -> Path | None:
    """The quickest stop on the path from where the joints are, at ``elapsed_s`` with time passing ``rate`` times.

    The path itself where that ends sooner; None where it leaves no room to brake soon and within the limits.
    """
    stops = sorted(_stops(path, elapsed_s, rate, limits), key=lambda one: one.duration_s)
    left_s = (path.duration_s - elapsed_s) / rate if rate > 0.0 else math.inf
    longest_s = LONGEST_STOP * stops[0].duration_s + STOP_MARGIN_S
    for stop in [one for one in stops if one.duration_s <= longest_s][:TRIES]:
        if left_s <= stop.duration_s:
            return path
        if _fits(stop, limits):
            return stop
    return path if left_s <= longest_s else None


def _stops(path: Path, elapsed_s: float, rate: float, limits: Sequence[JointLimits]) -> Iterator[Slowing]:
    """Stops on the path, whether they keep the limits or not."""
    for delay_s in DELAYS_S:
        at_s = min(elapsed_s + rate * delay_s, path.duration_s)
        speed = np.maximum(np.abs(path.sample(at_s).velocity), 1e-6)
        acceleration = min(limit.acceleration / v for limit, v in zip(limits, speed, strict=True))
        jerk = min(limit.jerk / v for limit, v in zip(limits, speed, strict=True))
        start = Kinematics(np.array([at_s]), np.array([rate]), np.zeros(1))
        for share in SHARES:
            bound = JointLimits(-math.inf, math.inf, max(rate, 1.0), acceleration * share, jerk * share)
            yield Slowing(path, plan_stop(start, [bound]), rate, delay_s)


def _fits(slowing: Slowing, limits: Sequence[JointLimits]) -> bool:
    """Whether braking accelerates no joint beyond its limit, or beyond what the path does anyway.

    Jerk has its limit twice, in the path and in the braking: where both are at it, nothing could be braked at once.
    """
    times_s = np.linspace(0.0, slowing.duration_s, LOOKS)
    braked = np.array([slowing.sample(time_s).acceleration for time_s in times_s])
    on_path_s = [slowing.on_path(time_s)[0] for time_s in times_s]
    own = np.array([slowing.path.sample(at_s).acceleration for at_s in on_path_s]) * slowing.rate**2
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
