"""Plausibility of position readings: a joint cannot have moved further than its servo can turn it.

A reply with false data passes an 8-bit checksum once in 256 times. A reading that leaps is therefore not believed until
the next one confirms it.
"""

import math
from typing import Final

from hal.joint import Joint

OVERSPEED: Final = 2.0
"""A driven servo may turn this many times as fast as without load: a higher supply, a falling arm, a late sample."""
BY_HAND_RAD_S: Final = 20.0
"""No hand turns a limp servo faster than this."""
SAMPLING_S: Final = 0.02
"""Uncertainty of the time between two readings: servos sample, and are asked again, at their own times."""
LONGEST_S: Final = 0.25
"""After a longer silence, every place further away than a joint gets in this time has to be confirmed."""
SLACK_COUNTS: Final = 8
"""Distance that is always plausible: noise and backlash."""


class Plausibility:
    """The position readings of one joint: the last plausible reading and the doubtful one after it."""

    def __init__(self, joint: Joint) -> None:
        unit = abs(joint.units_per_count)
        shaft = abs(joint.transmission)
        self._driven_speed = max(OVERSPEED * joint.model.no_load_speed_rad_s * shaft, joint.limits.velocity)
        self._limp_speed = max(self._driven_speed, BY_HAND_RAD_S * shaft)
        self._slack = SLACK_COUNTS * unit
        self._turn = joint.model.counts_per_turn * unit if joint.seam_inside else math.inf
        self._believed = self._doubted = math.nan
        self._believed_s = self._doubted_s = -math.inf

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
