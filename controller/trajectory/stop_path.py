"""Plan paths that stop the joints of a trajectory within the limits, either along their path or separately for each
joint."""

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.motion import Kinematics, MotionError, Path, RuckigMotion, plan_stop
from controller.trajectory.parameters import TrajectoryParameters
from hal.types import FloatArray, JointLimits

LOG = logging.getLogger("servoloop.controller")

SHARES: Final = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Fractions of the acceleration and jerk limits to try for a stop along a path. The path itself needs the remaining
fraction."""
DELAYS_S: Final = (0.0, 0.05, 0.1, 0.15, 0.2)
"""Delays to try for a stop along a path, in seconds. No stop can start while the path brakes at a limit."""
LONGEST_STOP: Final = 2.0
"""Maximum duration of a stop along a path, as a multiple of the duration of the quickest stop.

A path continues to its own end only if it ends at most ``STOP_MARGIN_S`` after the quickest stop. Such a path does not
slow down before its end, so the joints would travel much further than during a stop of the same duration.
"""
STOP_MARGIN_S: Final = 0.2
"""Time added to ``LONGEST_STOP`` times the quickest stop, and maximum time after the quickest stop at which a path may
end, in seconds."""
TRIES: Final = 12
"""Maximum number of stops to check against the limits, quickest first. The loop waits for these checks."""
SAMPLES: Final = 40
"""Number of instants at which the accelerations of a stop are compared with the limits."""
SLACK: Final = 1.001
"""Factor by which a sampled acceleration may exceed its limit, because paths use their limits fully."""


@dataclass(frozen=True, slots=True)
class Bounded:
    """A path that is clipped to the position limits ``lower`` and ``upper`` (n,). A joint that reaches a limit stops
    there immediately."""

    path: Path
    lower: FloatArray
    upper: FloatArray

    @property
    def duration_s(self) -> float:
        """Duration of the path, in seconds."""
        return self.path.duration_s

    @property
    def asked_s(self) -> float:
        """Requested duration of the path, in seconds."""
        return self.path.asked_s

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start."""
        state = self.path.sample(time_s)
        inside = np.clip(state.position, self.lower, self.upper)
        free = inside == state.position
        return Kinematics(inside, state.velocity * free, state.acceleration * free)


@dataclass(frozen=True, slots=True)
class Slowing:
    """A path on which time slows down until it stops.

    ``progress`` is a one-dimensional motion whose position is the time on the path. Until ``delay_s``, the time on the
    path advances at ``rate``.
    """

    path: Path
    progress: RuckigMotion
    rate: float = 1.0
    delay_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Time until the joints are at rest, in seconds."""
        return self.delay_s + self.progress.duration_s

    @property
    def asked_s(self) -> float:
        """Requested duration, in seconds. No client requests a duration for a stop, so this is the actual duration."""
        return self.duration_s

    def on_path(self, time_s: float) -> tuple[float, float, float]:
        """Return the time on the path (s) ``time_s`` after the start, its rate, and the change of the rate (1/s)."""
        later_s = time_s - self.delay_s
        now = self.progress.sample(later_s)
        if later_s < 0.0:
            return float(now.position[0]) + self.rate * later_s, self.rate, 0.0
        return float(now.position[0]), float(now.velocity[0]), float(now.acceleration[0])

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start."""
        at_s, rate, change = self.on_path(time_s)
        state = self.path.sample(at_s)
        acceleration: FloatArray = state.acceleration * rate**2 + state.velocity * change
        return Kinematics(state.position, state.velocity * rate, acceleration)


def stop_along(path: Path, elapsed_s: float, rate: float, limits: Sequence[JointLimits]) -> Path | None:
    """Return the quickest stop on a path from ``elapsed_s``, at which time passes at ``rate``.

    Returns the path itself if it ends about as soon as the quickest stop, and None if the path does not allow braking
    soon within the limits.
    """
    stops = sorted(_stops(path, elapsed_s, rate, limits), key=lambda stop: stop.duration_s)
    left_s = (path.duration_s - elapsed_s) / rate if rate > 0.0 else math.inf
    quickest_s = stops[0].duration_s
    longest_s = LONGEST_STOP * quickest_s + STOP_MARGIN_S
    ends_soon = left_s <= quickest_s + STOP_MARGIN_S
    for stop in [candidate for candidate in stops if candidate.duration_s <= longest_s][:TRIES]:
        if ends_soon and left_s <= stop.duration_s:
            return path
        if _fits(stop, limits):
            return stop
    return path if ends_soon else None


def _stops(path: Path, elapsed_s: float, rate: float, limits: Sequence[JointLimits]) -> Iterator[Slowing]:
    """Yield candidate stops along the path, which may exceed the limits."""
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
    """Return whether a stop keeps each joint's acceleration within its limit, or at most as high as on the path itself.

    The jerk limit applies separately to the path and to the stop. If their sum were limited, a path at its jerk limit
    could not be stopped immediately.
    """
    times_s = np.linspace(0.0, slowing.duration_s, SAMPLES)
    braked = np.array([slowing.sample(time_s).acceleration for time_s in times_s])
    on_path_s = [slowing.on_path(time_s)[0] for time_s in times_s]
    own = np.array([slowing.path.sample(at_s).acceleration for at_s in on_path_s]) * slowing.rate**2
    most = np.maximum([limit.acceleration for limit in limits], np.abs(own).max(axis=0))
    return bool((np.abs(braked) <= SLACK * most).all())


def stop_path(reference: Kinematics, limits: Sequence[JointLimits], gentle: Sequence[JointLimits]) -> Path:
    """Plan a gentle stop, or the fastest stop if the gentle stop would end outside the position limits.

    If even the fastest stop would end outside the limits (splines have no acceleration limit), the joint stops
    immediately at its limit.
    """
    lower = np.array([limit.lower for limit in limits])
    upper = np.array([limit.upper for limit in limits])
    try:
        for path in (plan_stop(reference, gentle), plan_stop(reference, limits)):
            end = path.sample(path.duration_s).position
            if ((end >= lower) & (end <= upper)).all():
                return path
        return Bounded(path, lower, upper)
    except MotionError as error:
        LOG.error("cannot plan a stop within the limits, so the joints stop abruptly: %s", error)
        return plan_stop(Kinematics.at_rest(reference.position), limits)


def gentle_limits(limits: Sequence[JointLimits], parameters: TrajectoryParameters) -> list[JointLimits]:
    """Return the limits with ``max_deceleration_on_cancel`` applied, which can only lower the acceleration limits."""
    by_joint = parameters.constraints.by_joint()
    asked = [by_joint[name].max_deceleration_on_cancel for name in parameters.joints]
    pairs = zip(limits, asked, strict=True)
    return [replace(limit, acceleration=min(limit.acceleration, a or math.inf)) for limit, a in pairs]
