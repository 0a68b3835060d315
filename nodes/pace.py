"""Something that is to be done at most so often, decided once a cycle."""

EARLY = 0.25
"""Share of the interval by which a cycle may come early: cycles are not exactly as far apart as each other."""


class Pace:
    """On average the rate that is asked for, or that of the cycles where it is lower."""

    def __init__(self) -> None:
        self._next_s = self._last_s = float("-inf")

    def due(self, now_s: float, rate_hz: float) -> bool:
        """Whether it is time. Begins anew where time was set back, as when a simulation begins again."""
        interval_s = 1.0 / rate_hz
        if now_s < self._last_s:
            self._next_s = now_s
        self._last_s = now_s
        if now_s < self._next_s - EARLY * interval_s:
            return False
        self._next_s = max(self._next_s + interval_s, now_s + (1.0 - EARLY) * interval_s)
        return True
