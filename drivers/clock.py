"""Clocks. All other core code reads the time and sleeps only through a clock."""

import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """Clock that never runs backward and has an arbitrary zero point."""

    def now(self) -> float:
        """Return the time, in seconds."""
        ...

    def sleep_until(self, deadline_s: float) -> None:
        """Sleep until a time. Return at once if this time has passed.

        Args:
            deadline_s: Time to wake up, in seconds on this clock.
        """
        ...


class MonotonicClock:
    """The monotonic clock of the operating system, which all processes on a machine share."""

    now = staticmethod(time.monotonic)

    def sleep_until(self, deadline_s: float) -> None:
        remaining_s = deadline_s - time.monotonic()
        if remaining_s > 0.0:
            time.sleep(remaining_s)


def computing_time(clock: Clock) -> Callable[[], float]:
    """Return a function that measures the computing time of the calling thread, in seconds.

    Args:
        clock: Clock of the thread.

    Returns:
        The CPU time of the thread. For a simulated thread, this is the time on its clock, because the thread never
        waits.
    """
    return time.thread_time if isinstance(clock, MonotonicClock) else clock.now


def wall_offset_s(clock: Clock, wall: Callable[[], float]) -> float:
    """Return the offset between ``clock`` and the time of day, in seconds. The fastest of five measurements is used."""
    readings = [(clock.now(), wall(), clock.now()) for _ in range(5)]
    before_s, wall_s, after_s = min(readings, key=lambda reading: reading[2] - reading[0])
    return wall_s - 0.5 * (before_s + after_s)
