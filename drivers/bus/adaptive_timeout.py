"""Adapt the reply timeout of single requests to the delay of recent replies.

A group read needs only one timeout, which can be long. If each servo is asked separately, long timeouts cost too much
time. However, a USB adapter with a latency timer of 16 ms needs a long timeout for every servo.
"""

from typing import Final

FIRST_REPLY_S: Final = 0.02
"""Reply timeout before the first reply, in seconds. The latency timer of an adapter can be 16 ms."""
RESPONSIVE_S: Final = 0.002
"""Margin above the slowest recent reply, for a servo that replied to its last request, in seconds."""
PROBE_S: Final = 0.0015
"""Minimum timeout for a servo that did not reply to its last request, in seconds."""
SPARE_S: Final = 0.001
"""Margin above the slowest recent reply, for a servo that did not reply to its last request, in seconds."""
FORGET: Final = 0.95
"""Factor by which the slowest recorded reply time decays with each reply."""


class AdaptiveTimeout:
    """Reply timeouts of one bus, in seconds, excluding the transmission time of the bytes."""

    def __init__(self) -> None:
        self._slowest_s: float | None = None
        self._missed = False

    def begin(self) -> None:
        """Begin a new round of requests. Until the first reply arrives, only one request per round gets the long
        timeout."""
        self._missed = False

    def reply_received(self, took_s: float) -> None:
        self._slowest_s = min(max(took_s, (self._slowest_s or 0.0) * FORGET, 0.0), FIRST_REPLY_S)

    def late_reply_received(self) -> None:
        """Record a reply that arrived after its timeout."""
        self._slowest_s = FIRST_REPLY_S

    def no_reply(self) -> None:
        self._missed = True

    @property
    def slowest_s(self) -> float:
        """Delay of the slowest recent reply, in seconds beyond the transmission time.

        The delay is 0 before the first reply.
        """
        return self._slowest_s or 0.0

    def wait_s(self, responsive: bool) -> float:
        """Return the timeout of the next reply. ``responsive`` must be True if the servo replied to its last
        request."""
        if self._slowest_s is None:
            return RESPONSIVE_S if self._missed else FIRST_REPLY_S
        return self._slowest_s + RESPONSIVE_S if responsive else max(PROBE_S, self._slowest_s + SPARE_S)
