"""Rest: whether joints stay where they are measured."""

from typing import Final

import numpy as np

from controller.trajectory.waypoints import BoolArray
from hal.types import FloatArray

RESTS_S: Final = 0.09
"""Time that a joint at rest stays in its place; less is where a joint turns round. Two cycles at 20 Hz."""
HELD_S: Final = 0.25
"""Time for which a joint rests off its command until it counts as held; a joint that catches up rests for less."""
LONGEST_REST_S: Final = 1.0
"""Maximum time that a goal waits for joints to rest; after it the goal ends although they swing."""


class Rest:
    """The time for which each joint has stayed in one place."""

    def __init__(self, still: FloatArray) -> None:
        """``still`` (n,): a joint that moves by no more has not left its place."""
        self._still = still
        self._place = np.full(len(still), np.nan)
        self.stayed_s = np.zeros(len(still))

    def look(self, position: FloatArray, step_s: float) -> None:
        """Compare a new measurement (n,) with the places of the joints; NaN: not measured."""
        moved = ~(np.abs(position - self._place) <= self._still)
        self.stayed_s = np.where(moved, 0.0, self.stayed_s + step_s)
        self._place = np.where(moved, position, self._place)

    def for_at_least(self, seconds: float | FloatArray) -> BoolArray:
        """The joints (n,) that have stayed in one place for so long."""
        stayed: BoolArray = self.stayed_s >= seconds
        return stayed
