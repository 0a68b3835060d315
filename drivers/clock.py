"""Where time comes from. Nothing else in the core asks for the time or sleeps."""

import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """Seconds on a clock that never goes backwards; its zero means nothing."""

    def now(self) -> float:
        """The time in seconds."""
        ...

    def sleep_until(self, deadline_s: float) -> None:
        """Return at ``deadline_s`` or a little later; at once if it has passed."""
        ...


class MonotonicClock:
    """The machine's own monotonic clock. All processes of one machine share it."""

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
