"""Leaps of position readings: a joint cannot have moved further than its drive can move it.

A reply with false data passes an 8-bit checksum once in 256 times. A reading that leaps is therefore not believed until
the next one confirms it.
"""

import math
from typing import Final, Self

from hal.joint import Joint
from hal.types import AT_LIMIT, JointLimits

OVERSPEED: Final = 2.0
"""A driven joint may move this many times as fast as its servo without load, or as its velocity limit if there is no
servo to ask: a higher supply, a falling arm, a late sample."""
BY_HAND_RAD_S: Final = 20.0
"""No hand turns a limp joint faster than this."""
SAMPLING_S: Final = 0.02
"""Uncertainty of the time between two readings: servos sample, and are asked again, at their own times."""
LONGEST_S: Final = 0.25
"""After a longer silence, every place further away than a joint gets in this time has to be confirmed."""
SLACK_COUNTS: Final = 8
"""Distance that is always plausible: noise and backlash."""
SLACK_SHARE: Final = 2.0 * AT_LIMIT
"""The same without a servo to ask, as a share of the joint's range, of a turn at most."""


class Plausibility:
    """The position readings of one joint: the last plausible reading and the doubtful one after it."""

    def __init__(self, driven_speed: float, limp_speed: float, slack: float, turn: float = math.inf) -> None:
        """Speeds in rad/s or m/s; ``slack`` and ``turn`` in rad or m. Readings a ``turn`` apart are the same place."""
        self._driven_speed, self._limp_speed = driven_speed, max(driven_speed, limp_speed)
        self._slack, self._turn = slack, turn
        self._believed = self._doubted = math.nan
        self._believed_s = self._doubted_s = -math.inf

    @classmethod
    def of_servo(cls, joint: Joint) -> Self:
        """The plausibility of a joint that a servo drives."""
        unit, shaft = abs(joint.units_per_count), abs(joint.transmission)
        return cls(
            max(OVERSPEED * joint.model.no_load_speed_rad_s * shaft, joint.limits.velocity),
            BY_HAND_RAD_S * shaft,
            SLACK_COUNTS * unit,
            joint.model.counts_per_turn * unit if joint.seam_inside else math.inf,
        )

    @classmethod
    def of_limits(cls, limits: JointLimits) -> Self:
        """The plausibility of a joint of which only the limits are known."""
        endless = math.isinf(limits.upper - limits.lower)
        slack = SLACK_SHARE * min(limits.upper - limits.lower, math.tau)
        return cls(OVERSPEED * limits.velocity, BY_HAND_RAD_S, slack, math.tau if endless else math.inf)

    def leap(self, position: float, now_s: float, driven: bool) -> float | None:
        """The distance (rad or m) by which a reading leaps; None if it is plausible, or confirms the reading before it.

        ``driven``: whether the servo has torque; a limp joint can be turned faster by hand.
        """
        speed = self._driven_speed if driven else self._limp_speed
        away = self._way(self._believed, position)
        # The first reading of all has nothing that could contradict it.
        confirmed = abs(self._way(self._doubted, position)) <= self._reach(speed, now_s - self._doubted_s)
        if confirmed or not abs(away) > self._reach(speed, now_s - self._believed_s):
            self._believed, self._believed_s = position, now_s
            self._doubted = math.nan
            return None
        self._doubted, self._doubted_s = position, now_s
        return away

    def _way(self, start: float, end: float) -> float:
        """The way between two readings; across the seam, where that lies inside the limits, the shorter one."""
        way = end - start
        return way if math.isinf(self._turn) or math.isnan(way) else math.remainder(way, self._turn)

    def _reach(self, speed: float, elapsed_s: float) -> float:
        return speed * (min(elapsed_s, LONGEST_S) + SAMPLING_S) + self._slack
