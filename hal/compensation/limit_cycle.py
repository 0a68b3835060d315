"""Damp limit cycles, in which a joint at rest oscillates within the backlash of its gears.

A servo pushes with the same minimum drive from both sides (its minimum startup force). If gravity does not hold the
link at one end of the backlash, the servo pushes it from one end to the other and back.
"""

import math
from typing import Final

GIVE_WAY_RAD: Final = 0.0046
"""Maximum offset of the goal, in rad at the shaft. The value equals three counts of an STS and is less than half of a
1-degree backlash.
"""
SLOW_CYCLES: Final = 6
"""Minimum period of an oscillation to be damped, in control cycles. A faster oscillation would be amplified."""
CALMED_CYCLES: Final = 5
"""Minimum period at which damping continues, in control cycles. The period becomes shorter as the oscillation decays.
"""
BEFORE_CYCLES: Final = 4
"""Assumed duration of the half period that precedes the first measured half period, in control cycles."""
RETURN_S: Final = 0.5
"""Time constant with which the offset decays after the oscillation ends."""


class LimitCycle:
    """Offset that damps the limit cycle of one joint, in rad or m.

    The goal of an oscillating joint is set to its last measured position. The servo then only acts against the motion,
    and the oscillation decays. Afterward, the goal stays at the position of the joint.
    """

    __slots__ = ("_before", "_cycles", "_dead_band", "_give_way", "_side", "offset", "swinging")

    def __init__(self, dead_band: float, transmission: float) -> None:
        """Create the offset.

        Args:
            dead_band: Error that does not count as an oscillation.
            transmission: Joint units per radian of the shaft.
        """
        self._dead_band = dead_band
        self._give_way = GIVE_WAY_RAD * transmission
        self.restart()

    def restart(self) -> None:
        """Discard the detected oscillation and reset the offset to zero."""
        self._side = 0
        self._cycles = 0
        self._before = BEFORE_CYCLES
        self.swinging = False
        """Whether the joint oscillates, or has oscillated since its command came to rest."""
        self.offset = 0.0
        """Offset of the goal from the command, in rad or m."""

    def update(self, error: float, loose: bool, dt_s: float) -> None:
        """Detect an oscillation and update the offset.

        A joint oscillates if it passes its commanded position by more than the dead band and then passes it again.

        Args:
            error: Command minus measured position; NaN if unknown.
            loose: Whether the joint's command is at rest and gravity does not hold the joint.
            dt_s: Period of the control loop, in seconds.
        """
        former = self._side
        side = (1 if error > 0.0 else -1) if abs(error) > self._dead_band else former
        passed = side * former < 0
        if passed:
            self.swinging = self._before + self._cycles >= (CALMED_CYCLES if self.swinging else SLOW_CYCLES)
            self._before = self._cycles
        self._cycles = self._cycles + 1 if side == former else 1
        if loose:
            self._side = side
        else:
            self._side, self._before, self.swinging = 0, BEFORE_CYCLES, False
        if not self.swinging:
            self.offset *= max(0.0, 1.0 - dt_s / RETURN_S)
        elif not math.isnan(error):
            self.offset = min(max(-error, -self._give_way), self._give_way)
