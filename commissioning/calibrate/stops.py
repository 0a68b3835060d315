"""Check whether a sweep has reached both stops of a joint.

The travel must be as long as the URDF range, or the same two stops must have been reached twice.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import tau
from typing import Final

from commissioning.calibrate.result import SWEPT_SHARE, missing_allowed, unit
from commissioning.calibrate.sweep import Sweep
from hal.joint import Joint

SAME_STOP_RAD: Final = 0.015
"""Maximum distance between the ends of two motions to the same stop, in rad of the servo's shaft."""


@dataclass(slots=True)
class _Visit:
    """Range of one joint's motion during one task, in continuous counts."""

    lower: int
    upper: int


class Stops:
    """Stops that the user has reached while sweeping the joints."""

    def __init__(self, sweep: Sweep, joints: Sequence[Joint]) -> None:
        self._sweep = sweep
        self._joints = tuple(joints)
        self._visits: dict[str, _Visit] = {}
        self._before: dict[str, _Visit] = {}

    def begin(self) -> None:
        """Begin a new task. All previous motion is treated as motion before this task."""
        self._before = {name: _Visit(one.lower, one.upper) for name, one in self._sweep.swept.items()}
        self._visits = {}

    def update(self) -> None:
        """Add the joints' current positions to their ranges in this task."""
        for joint in self._joints:
            swept = self._sweep.swept.get(joint.name)
            if swept is None:
                continue
            visit = self._visits.setdefault(joint.name, _Visit(swept.counts, swept.counts))
            visit.lower, visit.upper = min(visit.lower, swept.counts), max(visit.upper, swept.counts)

    def missing(self, joint: Joint) -> bool:
        """Return whether a stop may have been missed.

        A travel that is shorter than the URDF range is accepted after both of its ends were reached in two tasks.
        """
        swept, range_ = self._sweep.swept.get(joint.name), joint.limits.upper - joint.limits.lower
        if swept is None:
            return True
        travel = swept.travel.span * unit(joint)
        if travel >= range_ - missing_allowed(joint):
            return False
        return travel < SWEPT_SHARE * range_ or not self._reached_twice(joint)

    def _reached_twice(self, joint: Joint) -> bool:
        before, visit = self._before.get(joint.name), self._visits.get(joint.name)
        if before is None or visit is None:
            return False
        same = SAME_STOP_RAD * joint.model.counts_per_turn / tau
        return abs(visit.lower - before.lower) <= same and abs(visit.upper - before.upper) <= same

    def seen(self, joint: Joint) -> str:
        """Return a phrase that states how far the joint was moved."""
        swept, range_ = self._sweep.swept.get(joint.name), joint.limits.upper - joint.limits.lower
        if swept is None:
            return f"{joint.name}: servo {joint.servo_id} did not respond"
        travel = swept.travel.span * unit(joint)
        return f"{joint.name}: {travel:.3f} of {range_:.3f} in the URDF, {travel / range_:.1%}"
