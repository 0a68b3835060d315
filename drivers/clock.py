"""Where time comes from. Nothing else in the core asks for the time or sleeps."""

import math
import time
from collections.abc import Callable
from typing import Final, Protocol

_TRIES: Final = 5
_AT_ONCE_S: Final = 20e-6
"""Nobody was held up for longer between the readings of two clocks."""


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
    """What to add to ``clock`` for the time of day (s), right to some microseconds also on a busy machine.

    A thread that is held up between the two readings would be wrong by just as long: then they are read again.
    """
    shortest_s, offset_s = math.inf, 0.0
    for _ in range(_TRIES):
        before_s, wall_s, after_s = clock.now(), wall(), clock.now()
        if after_s - before_s < shortest_s:
            shortest_s, offset_s = after_s - before_s, wall_s - 0.5 * (before_s + after_s)
        if shortest_s < _AT_ONCE_S:
            break
    return offset_s
