"""Damp limit cycles: a joint at rest may oscillate within the backlash of its gears.

A servo pushes with the same minimum drive from both sides (its minimum starting force). If gravity does not hold the
link at one end of the backlash, the servo pushes it from one end to the other and back.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray

GIVE_WAY_RAD: Final = 0.0046
"""Maximum offset of the goal, in rad of the shaft: three counts of an STS, less than half of a backlash of 1 degree."""
SLOW_CYCLES: Final = 6
"""Minimum period of an oscillation that is damped, in control cycles. A faster oscillation would be amplified."""
CALMED_CYCLES: Final = 5
"""Minimum period of an oscillation whose damping continues, in control cycles. Its period decreases with its size."""
BEFORE_CYCLES: Final = 4
"""Assumed duration of the half period before the first measured half period, in control cycles."""
RETURN_S: Final = 0.5
"""Time constant with which the offset decays after the oscillation ends."""


class LimitCycle:
    """Offsets that damp the limit cycles of n joints. Arrays have shape (n,), in rad or m.

    The goal of an oscillating joint is set to its last measured position. The servo then only acts against the motion,
    and the oscillation decays. Afterwards the goal stays at the position of the joint.
    """

    def __init__(self, dead_band: FloatArray, transmission: FloatArray) -> None:
        """Create the offsets.

        Args:
            dead_band: Errors that do not count as an oscillation.
            transmission: Joint units per radian of the shaft.
        """
        self._dead_band = dead_band
        self._give_way = GIVE_WAY_RAD * transmission
        self.restart()

    def restart(self) -> None:
        """Discard all oscillations."""
        self._side = np.zeros(len(self._dead_band))
        self._cycles = np.zeros(len(self._dead_band))
        self._before = np.full(len(self._dead_band), BEFORE_CYCLES)
        self.swinging: NDArray[np.bool_] = np.zeros(len(self._dead_band), dtype=bool)
        """Whether each joint oscillates, or has oscillated since its command came to rest."""
        self.offset = np.zeros(len(self._dead_band))
        """Offsets of the goals."""

    def update(self, error: FloatArray, loose: NDArray[np.bool_], dt_s: float) -> None:
        """Detect oscillations and update the offsets.

        A joint oscillates if it passes its command by more than the dead band and then passes it again.

        Args:
            error: Command minus measured position; NaN if unknown.
            loose: Whether the command of each joint is at rest and gravity does not hold the joint.
            dt_s: Period of the control loop, in seconds.
        """
        side = np.where(np.abs(error) > self._dead_band, np.sign(error), self._side)
        passed = side * self._side < 0.0
        slow = self._before + self._cycles >= np.where(self.swinging, CALMED_CYCLES, SLOW_CYCLES)
        self.swinging = loose & np.where(passed, slow, self.swinging)
        self._before = np.where(loose, np.where(passed, self._cycles, self._before), BEFORE_CYCLES)
        self._cycles = np.where(side == self._side, self._cycles + 1, 1)
        self._side = np.where(loose, side, 0.0)
        beside = np.where(np.isnan(error), self.offset, np.clip(-error, -self._give_way, self._give_way))
        self.offset = np.where(self.swinging, beside, self.offset * max(0.0, 1.0 - dt_s / RETURN_S))
