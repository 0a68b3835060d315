"""Detect jumps in position readings: a joint cannot move further than its servo can drive it.

One in 256 corrupt replies passes an 8-bit checksum. A reading that jumps is therefore rejected until the next
reading confirms it.

The reading of a shaft that something pushes over the seam of its encoder leaps to the other end of the range. The servo
itself counts turns, so the shaft returns the way it came. If the stack believed such a reading, it would move the goal
away from the shaft.
"""

import math
from collections.abc import Collection, Sequence
from typing import Final, Self

from hal.joint import Joint
from hal.types import AT_LIMIT, JointLimits

OVERSPEED: Final = 2.0
"""Highest plausible speed of a driven joint, as a multiple of the no-load speed of its servo.

If the servo is unknown, the speed is a multiple of the velocity limit. The margin covers a higher supply voltage, a
falling arm and a late sample.
"""
BY_HAND_RAD_S: Final = 20.0
"""Highest plausible speed of a limp joint when moved by hand, in rad/s."""
SAMPLING_S: Final = 0.02
"""Uncertainty of the time between two readings. Servos sample on their own clock, and reads may be repeated."""
LONGEST_S: Final = 0.25
"""Maximum elapsed time used to compute the plausible distance, no matter how long the servo was silent."""
CROSSES: Final = 0.125
"""Maximum distance that a shaft moves while it crosses the seam of its encoder, in turns."""
SLACK_COUNTS: Final = 8
"""Distance that is always plausible because of noise and backlash, in counts."""
SLACK_SHARE: Final = 2.0 * AT_LIMIT
"""Distance that is always plausible if the servo is unknown, as a fraction of the joint's range (at most one turn)."""


class Plausibility:
    """Plausibility check for the position readings of one joint."""

    def __init__(self, driven_speed: float, limp_speed: float, slack: float, turn: float = math.inf) -> None:
        """Initialize the check.

        Args:
            driven_speed: Highest plausible speed while torque is enabled, in rad/s or m/s.
            limp_speed: Highest plausible speed of a limp joint, in rad/s or m/s.
            slack: Distance that is always plausible, in rad or m.
            turn: Distance after which positions repeat, in rad or m.
        """
        self._driven_speed, self._limp_speed = driven_speed, max(driven_speed, limp_speed)
        self._slack, self._turn, self._straight = slack, turn, math.isinf(turn)
        self._accepted = self._rejected = math.nan
        self._accepted_s = self._rejected_s = -math.inf

    @classmethod
    def of_servo(cls, joint: Joint) -> Self:
        """Create the check for a joint whose servo is known."""
        unit, shaft = abs(joint.units_per_count), abs(joint.transmission)
        return cls(
            max(OVERSPEED * joint.model.no_load_speed_rad_s * shaft, joint.limits.velocity),
            BY_HAND_RAD_S * shaft,
            SLACK_COUNTS * unit,
            joint.model.counts_per_turn * unit if joint.seam_inside else math.inf,
        )

    @classmethod
    def of_limits(cls, limits: JointLimits) -> Self:
        """Create the check for a joint if only its limits are known."""
        endless = math.isinf(limits.upper - limits.lower)
        slack = SLACK_SHARE * min(limits.upper - limits.lower, math.tau)
        return cls(OVERSPEED * limits.velocity, BY_HAND_RAD_S, slack, math.tau if endless else math.inf)

    def leap(self, position: float, now_s: float, driven: bool) -> float | None:
        """Check one reading.

        Args:
            position: Measured position, in rad or m.
            now_s: Time of the reading, in seconds.
            driven: Whether the servo's torque is enabled. A limp joint can be moved faster by hand.

        Returns:
            The distance by which the reading jumps, in rad or m. None if the reading is plausible or confirms the
            previous reading.
        """
        speed = self._driven_speed if driven else self._limp_speed
        away = position - self._accepted if self._straight else self._distance(self._accepted, position)
        # The first reading is accepted, because its distance from NaN is NaN, and NaN does not compare as greater than
        # the reach.
        plausible = not abs(away) > self._reach(speed, now_s - self._accepted_s)
        if plausible or abs(self._distance(self._rejected, position)) <= self._reach(speed, now_s - self._rejected_s):
            self._accepted, self._accepted_s, self._rejected = position, now_s, math.nan
            return None
        self._rejected, self._rejected_s = position, now_s
        return away

    def _distance(self, start: float, end: float) -> float:
        """Return the signed distance between two readings.

        If positions repeat after a turn, this is the shorter distance.
        """
        distance = end - start
        return distance if self._straight or math.isnan(distance) else math.remainder(distance, self._turn)

    def _reach(self, speed: float, elapsed_s: float) -> float:
        return speed * (min(elapsed_s, LONGEST_S) + SAMPLING_S) + self._slack


class SeamCrossings:
    """Whole turns that the readings of driven servos lack because their shafts were pushed over the encoder's seam.

    A second reading must confirm each crossing. A joint that moved too fast to be followed is not followed again before
    its next activation. A joint whose range contains the seam is not followed, because the servo counts its turns in
    the range. A limp joint can be turned by hand by whole turns, so its caller calls ``forget`` instead.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        """Follow the joints whose encoders cover a full turn."""
        self._turn = {
            joint.name: joint.model.counts_per_turn
            for joint in joints
            if joint.model.positions is None and not joint.seam_inside
        }
        self._missing = dict.fromkeys(self._turn, 0)
        """Whole turns that the reading of each joint lacks, in counts."""
        self._unconfirmed = dict.fromkeys(self._turn, 0)
        """Unconfirmed change of ``_missing`` according to the latest reading."""
        self._seen: dict[str, int] = {}
        """Last believed position of each joint, in counts. This position is beyond the range of the encoder if the
        shaft has crossed the seam."""
        self._leapt: set[str] = set()
        """Joints whose position has leapt since their activation. Their turn is not certain, so their readings are
        believed within a single turn."""

    def forget(self, names: Collection[str] | None = None) -> None:
        """Believe the next reading of these joints, or of all joints, within a single turn."""
        for name in self._turn if names is None else names & self._turn.keys():
            self._missing[name] = self._unconfirmed[name] = 0
            self._seen.pop(name, None)
            self._leapt.discard(name)

    def counts(self, name: str, reading: int) -> int:
        """Return the counts of a reading, with the whole turns that it lacks. A leap is returned as it was read."""
        seen = self._seen.get(name)
        if seen is None or name in self._leapt:
            return reading
        turn, counts = self._turn[name], reading + self._missing[name]
        moved = round(math.remainder(counts - seen, turn))
        if abs(moved) > CROSSES * turn:
            return reading
        crossed, before = seen + moved - counts, self._unconfirmed[name]
        self._unconfirmed[name] = 0 if crossed == before else crossed
        if crossed and crossed == before:
            self._missing[name] += crossed
            return counts + crossed
        return counts

    def believed(self, name: str, counts: int) -> None:
        """Note a position that is plausible."""
        if name not in self._turn:
            return
        seen = self._seen.get(name)
        if seen is not None and abs(counts - seen) > CROSSES * self._turn[name]:
            self._leapt.add(name)
            self._missing[name] = self._unconfirmed[name] = 0
        self._seen[name] = counts
