"""A motion that goes on only as long as somebody says so: a set point that is always a little ahead of the joints."""

from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray

HORIZON_S: Final = 0.3
"""The set point is so far ahead in time, and each command ends there at rest: so long after the last word the joints
stand, whatever has become of who said it."""
FURTHEST: Final = 0.15
"""No set point is so far (rad or m) from where its joint is measured: one that is blocked is not pressed on further."""
NEAR: Final = 2e-3
"""A joint is there within so many rad or m."""


class Standing(NamedTuple):
    """Where some joints stand: arrays (n,), rad or m."""

    commanded: FloatArray
    measured: FloatArray


class GuidedMotion:
    """The set point of some joints. Arrays (n,), rad or m."""

    def __init__(self, position: FloatArray, lower: FloatArray, upper: FloatArray, fastest: FloatArray) -> None:
        """It begins where the joints are commanded to be; those that stand outside their limits may come in.

        ``fastest``: the velocities (n,) at which the set point moves at the most.
        """
        self.set_point = position.copy()
        self._lower, self._upper = np.minimum(lower, position), np.maximum(upper, position)
        self._fastest = fastest

    def go(self, velocity: FloatArray, passed_s: float, at: Standing) -> FloatArray:
        """The set point after so long at this velocity, no further ahead of the joints than is slowly gone in time.

        Where the joints are not commanded to follow, for a fault or a stop, or cannot, the set point does not run away
        from them, and they do not leap when they follow again.
        """
        step = np.clip(velocity, -self._fastest, self._fastest) * min(passed_s, HORIZON_S)
        reach = self._fastest * HORIZON_S
        ahead = np.clip(self.set_point + step, at.commanded - reach, at.commanded + reach)
        near = np.clip(ahead, at.measured - FURTHEST, at.measured + FURTHEST)
        self.set_point = np.clip(near, self._lower, self._upper)
        return self.set_point

    def go_to(self, target: FloatArray, passed_s: float, at: Standing) -> bool:
        """The set point goes on for so long towards a target, on a straight line; whether they are told to be there."""
        target = np.clip(target, self._lower, self._upper)
        way = target - self.set_point
        whole_s = float((np.abs(way) / self._fastest).max())
        self.go(way / max(whole_s, passed_s, 1e-6), passed_s, at)
        return bool((np.abs(target - at.commanded) <= NEAR).all())
