"""Shared QoS profiles and a rate limiter for publishers."""

from array import array
from typing import Final

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from hal.types import FloatArray

LATCHED: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Publisher profile of ros2_control. A late subscriber immediately receives the latest message."""
LATCHED_WHILE_NEW: Final = QoSProfile(depth=1, durability=LATCHED.durability, lifespan=Duration(seconds=0.5))
"""Profile like LATCHED, for topics that are published only while they have subscribers. An old message expires after
0.5 s."""
ANY_CLIENT: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Subscriber profile of ros2_control. The subscriber also accepts best-effort publishers, because the next command
replaces a lost command."""
EVERY_CALL: Final = QoSProfile(depth=1, history=HistoryPolicy.KEEP_ALL)
"""Service profile that keeps every request in a burst."""


def numbers(values: FloatArray) -> "array[float]":
    """Convert values (n,) to an array. rclpy assigns arrays directly, but checks every element of a list."""
    return array("d", values.tobytes())


EARLY = 0.25
"""Fraction of the interval by which a message may be early, because cycles are not spaced exactly evenly."""


class RateLimiter:
    """Rate limiter for a publisher. The average rate is the given rate, or the cycle rate if that is lower."""

    def __init__(self) -> None:
        self._next_s = self._last_s = float("-inf")

    def due(self, now_s: float, rate_hz: float) -> bool:
        """Return whether the next message is due. The limiter restarts if time jumps backward, as in a simulation."""
        interval_s = 1.0 / rate_hz
        if now_s < self._last_s:
            self._next_s = now_s
        self._last_s = now_s
        if now_s < self._next_s - EARLY * interval_s:
            return False
        self._next_s = max(self._next_s + interval_s, now_s + (1.0 - EARLY) * interval_s)
        return True
