"""Measure the frame rate."""

from collections import deque
from typing import Final

WINDOW: Final = 30
"""Number of frames over which the rate is measured."""


class RateMeter:
    """Frame rate over the most recent frames."""

    def __init__(self) -> None:
        self._stamps_s: deque[float] = deque(maxlen=WINDOW)

    @property
    def rate_hz(self) -> float:
        """Rate in Hz, or 0.0 before the second frame."""
        if len(self._stamps_s) < 2 or self._stamps_s[-1] <= self._stamps_s[0]:
            return 0.0
        return (len(self._stamps_s) - 1) / (self._stamps_s[-1] - self._stamps_s[0])

    def add(self, stamp_s: float) -> None:
        """Count a frame that was captured at the given time, in seconds."""
        self._stamps_s.append(stamp_s)
