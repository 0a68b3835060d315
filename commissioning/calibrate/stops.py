"""Whether a sweep has reached both stops of a joint: as far apart as the URDF has them, or reached twice."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import tau
from typing import Final

from commissioning.calibrate.result import SWEPT_SHARE, missing_allowed, unit
from commissioning.calibrate.sweep import Sweep
from hal.joint import Joint

SAME_STOP_RAD: Final = 0.015
"""Two visits to one stop end no further apart than this."""


@dataclass(slots=True)
class _Visit:
    """The extent of one joint's motion during one task, in continuous counts."""

    lower: int
    upper: int


class Stops:
    """The stops of the joints that are swept; ``begin`` begins another task."""

    def __init__(self, sweep: Sweep, joints: Sequence[Joint]) -> None:
        self._sweep = sweep
        self._joints = tuple(joints)
        self._visits: dict[str, _Visit] = {}
        self._before: dict[str, _Visit] = {}

    def begin(self) -> None:
        """Another task begins: what was swept until now was swept before it."""
        self._before = {name: _Visit(one.lower, one.upper) for name, one in self._sweep.swept.items()}
        self._visits = {}

    def look(self) -> None:
        """Note how far the joints are moved in this task."""
        for joint in self._joints:
            swept = self._sweep.swept.get(joint.name)
            if swept is None:
                continue
            visit = self._visits.setdefault(joint.name, _Visit(swept.counts, swept.counts))
            visit.lower, visit.upper = min(visit.lower, swept.counts), max(visit.upper, swept.counts)

    def missing(self, joint: Joint) -> bool:
        """Whether a stop may have been missed.

        A travel that is shorter than the URDF's range is believed once both of its ends were reached in two tasks.
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
        """A phrase about how far the joint was moved."""
        swept, range_ = self._sweep.swept.get(joint.name), joint.limits.upper - joint.limits.lower
        if swept is None:
            return f"{joint.name}: servo {joint.servo_id} did not answer"
        travel = swept.travel.span * unit(joint)
        return f"{joint.name}: {travel:.3f} of {range_:.3f} in the URDF, {travel / range_:.1%}"
