"""Limit cycles: a joint at rest that swings to and fro through the backlash of its gears.

A servo pushes with the same least drive from either side (its minimum starting force). Where gravity does not hold the
link at one end of the gap, it is thrown through, caught on the other side, and thrown back.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray

GIVE_WAY_RAD: Final = 0.0046
"""How far the goal may follow the shaft, three counts of an STS: half of the backlash of about a degree, and less."""
SLOW_CYCLES: Final = 6
"""A swing that is slow enough lasts so many cycles of the loop, there and back; a faster one it would drive."""
CALMED_CYCLES: Final = 5
"""One that is being calmed becomes faster as it becomes smaller: it is let go when it lasts less."""
BEFORE_CYCLES: Final = 4
"""Before the first half of a swing another one is taken to have lasted so long."""
RETURN_S: Final = 0.5
"""Time constant with which the goal returns once the command moves on."""


class LimitCycle:
    """Offsets that end the limit cycles of n joints: for one that swings, the goal goes along.

    A goal that is where the joint just was pulls against its motion only, so the swing dies out; then the goal stays
    beside the joint. Arrays (n,), rad or m.
    """

    def __init__(self, dead_band: FloatArray, transmission: FloatArray) -> None:
        """``dead_band``: errors of so much are no swing. ``transmission``: joint units per radian of the shaft."""
        self._dead_band = dead_band
        self._give_way = GIVE_WAY_RAD * transmission
        self.restart()

    def restart(self) -> None:
        """Forget all swings."""
        self._side = np.zeros(len(self._dead_band))
        self._cycles = np.zeros(len(self._dead_band))
        self._before = np.full(len(self._dead_band), BEFORE_CYCLES)
        self.swinging: NDArray[np.bool_] = np.zeros(len(self._dead_band), dtype=bool)
        """Which joints swing, or did since their commands stand."""
        self.offset = np.zeros(len(self._dead_band))
        """How far the goals go along."""

    def update(self, error: FloatArray, loose: NDArray[np.bool_], dt_s: float) -> None:
        """Look at the errors, command less measured position (NaN: unknown).

        ``loose``: joints whose command stands, and which gravity does not hold. One that passes its command by more
        than the dead band, and comes back past it, swings.
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
