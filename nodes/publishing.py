"""Qualities of service that several nodes share, and a limit on how often something is published."""

from typing import Final

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

LATCHED: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A publisher's profile, as upstream's: a late subscriber gets the newest message at once."""
LATCHED_WHILE_NEW: Final = QoSProfile(depth=1, durability=LATCHED.durability, lifespan=Duration(seconds=0.5))
"""The same for topics that are published to subscribers only: the newest message may be old."""
ANY_CLIENT: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""A subscriber's profile, as upstream's: also for best effort publishers; the next command makes up for a lost one."""
EVERY_CALL: Final = QoSProfile(depth=1, history=HistoryPolicy.KEEP_ALL)
"""A service's profile: no call of a burst is lost."""


EARLY = 0.25
"""Share of the interval by which a cycle may come early: cycles are not exactly as far apart as each other."""


class RateLimiter:
    """Allows on average the rate that is asked for, or the rate of the cycles where that is lower."""

    def __init__(self) -> None:
        self._next_s = self._last_s = float("-inf")

    def due(self, now_s: float, rate_hz: float) -> bool:
        """True when the next one is due. The limiter begins anew where time was set back, as by a simulation."""
        interval_s = 1.0 / rate_hz
        if now_s < self._last_s:
            self._next_s = now_s
        self._last_s = now_s
        if now_s < self._next_s - EARLY * interval_s:
            return False
        self._next_s = max(self._next_s + interval_s, now_s + (1.0 - EARLY) * interval_s)
        return True
