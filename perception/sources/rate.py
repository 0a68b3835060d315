"""Measure the rate of frames."""

from collections import deque
from typing import Final

WINDOW: Final = 30
"""Number of frames over which the rate is measured."""


class RateMeter:
    """Rate of the last frames."""

    def __init__(self) -> None:
        self._stamps_s: deque[float] = deque(maxlen=WINDOW)

    @property
    def rate_hz(self) -> float:
        """Rate, in Hz; 0.0 before the second frame."""
        if len(self._stamps_s) < 2 or self._stamps_s[-1] <= self._stamps_s[0]:
            return 0.0
        return (len(self._stamps_s) - 1) / (self._stamps_s[-1] - self._stamps_s[0])

    def add(self, stamp_s: float) -> None:
        """Count a frame that was captured at a time, in seconds."""
        self._stamps_s.append(stamp_s)
