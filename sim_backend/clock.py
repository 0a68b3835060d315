"""Clock that does not wait. Its time advances only when the program sleeps."""

from collections.abc import Callable
from math import inf


class Hang(BaseException):
    """Raised when a simulated program does not exit. Hang does not inherit from Exception, so that the program under
    test cannot catch it."""


class SimulatedClock:
    """A ``drivers.clock.Clock`` whose ``sleep_until`` advances the time immediately.

    The clock starts at time ``start_s``, in seconds.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self.last_s = inf
        """Time after which ``sleep_until`` raises Hang."""
        self.on_time: Callable[[float], None] | None = None
        """Function that is called with each new time."""

    def now(self) -> float:
        return self._now_s

    def sleep_until(self, deadline_s: float) -> None:
        """Advance the time to ``deadline_s``. Raises Hang after ``last_s``."""
        self._now_s = max(self._now_s, deadline_s)
        if self.on_time is not None:
            self.on_time(self._now_s)
        if self._now_s > self.last_s:
            raise Hang(f"the program took longer than {self.last_s:g} s of simulated time")
