"""A clock that does not wait: time passes only when somebody sleeps."""


class SimulatedClock:
    """A ``drivers.clock.Clock`` whose ``sleep_until`` jumps. Seconds; starts where it is told."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now(self) -> float:
        return self._now_s

    def sleep_until(self, deadline_s: float) -> None:
        self._now_s = max(self._now_s, deadline_s)
