"""A clock that does not wait. Its time advances only when the program sleeps."""


class SimulatedClock:
    """A ``drivers.clock.Clock`` whose ``sleep_until`` advances the time at once.

    It starts at ``start_s``, in seconds.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now(self) -> float:
        return self._now_s

    def sleep_until(self, deadline_s: float) -> None:
        self._now_s = max(self._now_s, deadline_s)
