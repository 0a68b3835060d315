"""The wait for a reply that may not come is learnt from those that do.

One wait for a whole group can be generous. Where every servo has a wait of its own, a USB adapter with a latency timer
of 16 ms needs seven of them; a quick one must not be waited for that long.
"""

from typing import Final

FIRST_REPLY_S: Final = 0.02
"""How long a reply may take while nothing is known of the line: a latency timer can be 16 ms."""
RESPONSIVE_S: Final = 0.002
"""Beyond the slowest reply of late, for a servo that answered the last time."""
PROBE_S: Final = 0.0015
"""For one that did not, if the line is quick."""
SPARE_S: Final = 0.001
FORGET: Final = 0.95
"""What is left of the slowest after one more reply."""


class AdaptiveTimeout:
    """The waits on one line. Times are seconds beyond the bytes' own time on the wire."""

    def __init__(self) -> None:
        self._slowest_s: float | None = None
        self._in_vain = False

    def begin(self) -> None:
        """A new round of questions. Each may wait long once in vain, while nothing is known."""
        self._in_vain = False

    def heard(self, took_s: float) -> None:
        """A reply came."""
        self._slowest_s = min(max(took_s, (self._slowest_s or 0.0) * FORGET, 0.0), FIRST_REPLY_S)

    def heard_late(self) -> None:
        """A reply came that was waited for too shortly."""
        self._slowest_s = FIRST_REPLY_S

    def in_vain(self) -> None:
        """No reply came."""
        self._in_vain = True

    def wait_s(self, responsive: bool) -> float:
        """How long to wait for the next reply."""
        if self._slowest_s is None:
            return RESPONSIVE_S if self._in_vain else FIRST_REPLY_S
        return self._slowest_s + RESPONSIVE_S if responsive else max(PROBE_S, self._slowest_s + SPARE_S)
