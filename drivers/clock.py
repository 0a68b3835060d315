"""Where time comes from. Nothing else in the core asks for the time or sleeps."""

import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """Source of time. It never goes backwards; its zero has no meaning."""

    def now(self) -> float:
        """Return the current time, in seconds."""
        ...

    def sleep_until(self, deadline_s: float) -> None:
        """Sleep until a time. Return at once if it has passed.

        Args:
            deadline_s: Time to wake up, in seconds on this clock.
        """
        ...


class MonotonicClock:
    """Monotonic clock of the machine. All processes of a machine share it."""

    now = staticmethod(time.monotonic)

    def sleep_until(self, deadline_s: float) -> None:
        remaining_s = deadline_s - time.monotonic()
        if remaining_s > 0.0:
            time.sleep(remaining_s)


def wall_offset_s(clock: Clock, wall: Callable[[], float]) -> float:
    """What to add to ``clock`` for the time of day (s): of five readings of both the one that was held up least."""
    readings = [(clock.now(), wall(), clock.now()) for _ in range(5)]
    before_s, wall_s, after_s = min(readings, key=lambda reading: reading[2] - reading[0])
    return wall_s - 0.5 * (before_s + after_s)
