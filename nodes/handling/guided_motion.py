"""A motion that goes on only as long as somebody says so: set points, and ways on which each comes to rest."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray

AHEAD_S: Final = 0.12
"""So far ahead a way goes on as it is; it is renewed more than twice in this time."""
BRAKE_S: Final = 0.15
"""And then comes to rest in so long: the joints rest 0.27 s after the last word, whatever has become of who said it."""
NEAR: Final = 1e-3
"""A joint is there within so many rad or m."""


class WayPoint(NamedTuple):
    """A point of a way: positions (n,) in rad or m, velocities (n,), seconds from now."""

    position: FloatArray
    velocity: FloatArray
    time_s: float


class GuidedMotion:
    """The set point of some joints. Arrays (n,), rad or m."""

    def __init__(self, position: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
        """It begins at rest at ``position``; joints that stand outside their limits may come in."""
        self.position, self.velocity = position.copy(), np.zeros_like(position)
        self._lower, self._upper = np.minimum(lower, position), np.maximum(upper, position)

    def go(self, velocity: FloatArray, fastest: float, passed_s: float) -> None:
        """Go on for so long, towards this velocity: as fast as ``fastest`` is reached in ``BRAKE_S``, not sooner."""
        change = fastest / BRAKE_S * passed_s
        wanted = np.clip(velocity, -self._room(self.position - self._lower), self._room(self._upper - self.position))
        self.velocity = self.velocity + np.clip(wanted - self.velocity, -change, change)
        self.position = np.clip(self.position + self.velocity * passed_s, self._lower, self._upper)

    def go_to(self, target: FloatArray, fastest: float, passed_s: float) -> bool:
        """Go on for so long towards a position, all joints together; whether it is reached."""
        way = np.clip(target, self._lower, self._upper) - self.position
        furthest = float(np.abs(way).max())
        if furthest < NEAR and float(np.abs(self.velocity).max()) < NEAR:
            return True
        share = min(fastest, furthest / (AHEAD_S + BRAKE_S)) / max(furthest, NEAR)
        self.go(way * share, fastest, passed_s)
        return False

    def way(self) -> Sequence[WayPoint]:
        """From here on, if nobody says another word: on for ``AHEAD_S``, then to rest."""
        on = np.clip(self.position + self.velocity * AHEAD_S, self._lower, self._upper)
        rest = np.clip(on + self.velocity * BRAKE_S / 2.0, self._lower, self._upper)
        return WayPoint(on, self.velocity, AHEAD_S), WayPoint(rest, np.zeros_like(rest), AHEAD_S + BRAKE_S)

    def end(self) -> Sequence[WayPoint]:
        """To rest, from now on."""
        rest = np.clip(self.position + self.velocity * BRAKE_S / 2.0, self._lower, self._upper)
        self.position, self.velocity = rest, np.zeros_like(rest)
        return (WayPoint(rest, self.velocity, BRAKE_S),)

    def _room(self, left: FloatArray) -> FloatArray:
        """The velocity at which a joint with so much way left still comes to rest in it."""
        room: FloatArray = np.maximum(left, 0.0) / (AHEAD_S + BRAKE_S / 2.0)
        return room
