"""Detect joints that are at rest."""

from typing import Final

import numpy as np

from controller.trajectory.waypoints import BoolArray
from hal.types import FloatArray

RESTS_S: Final = 0.09
"""Minimum time for which a joint must stay in place to count as at rest, in seconds (two cycles at 20 Hz).

A joint that reverses its direction stays in place for less time than this.
"""
HELD_S: Final = 0.25
"""Minimum time for which a joint must rest away from its command to count as blocked, in seconds.

A joint that is catching up with its command rests for less time than this.
"""
LONGEST_REST_S: Final = 1.0
"""Maximum time that a goal waits for its joints to come to rest, in seconds. After this time, the goal ends even if
joints are still oscillating.
"""
LONGEST_SLIDE_S: Final = 4.0
"""Maximum time that the relief waits for joints away from their commands to come to rest, in seconds. A joint that is
pushed along an obstacle, or by a neighbor, slides for a few seconds."""


class Rest:
    """Detector of joints at rest, which measures the time that each joint has stayed in place."""

    def __init__(self, still: FloatArray) -> None:
        """Set ``still`` (n,), the largest change of position that does not count as motion."""
        self._still = still
        self._place = np.full(len(still), np.nan)
        self.stayed_s = np.zeros(len(still))

    def update(self, position: FloatArray, step_s: float, creeps: FloatArray | float = 0.0) -> None:
        """Add the measured positions (n,) of one cycle.

        Args:
            position: Measured positions (n,). NaN marks a joint that was not measured.
            step_s: Time since the previous cycle, in seconds.
            creeps: Largest change of position that does not count as motion in this cycle, used if it exceeds
                ``still``.
        """
        moved = ~(np.abs(position - self._place) <= np.maximum(self._still, creeps))
        self.stayed_s = np.where(moved, 0.0, self.stayed_s + step_s)
        self._place = np.where(moved, position, self._place)

    def for_at_least(self, seconds: float | FloatArray) -> BoolArray:
        """Return which joints (n,) have stayed in place for at least ``seconds``."""
        stayed: BoolArray = self.stayed_s >= seconds
        return stayed
