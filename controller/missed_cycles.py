"""Report missed cycles of the loop: their percentage, their cause, and the highest rate that the loop sustained."""

import math
from collections import deque
from typing import Final, NamedTuple

from drivers.printable import counted

REPORT_AGAIN_S: Final = 1.0
"""Minimum time between two reports, in seconds. More log lines would delay the loop even further."""
REMEMBERED_CYCLES: Final = 1000
"""Number of recent cycles used to compute the highest rate."""
FEWEST_CYCLES: Final = 200
"""Minimum number of cycles needed to compute the highest rate."""
KEPT_SHARE: Final = 0.995
"""Fraction of recent cycles that must be on time at a rate for the rate to count as sustained."""


class CycleTimes(NamedTuple):
    """Duration of one cycle, measured from its due time and split by cause, in seconds."""

    machine_s: float
    """Time during which the thread was ready but did not run."""
    bus_s: float
    """Duration of the read, including the wait for the servos."""
    computing_s: float
    """Processor time of all steps after the read."""

    @property
    def total_s(self) -> float:
        """Time from the cycle's due time to its end."""
        return self.machine_s + self.bus_s + self.computing_s

    def __str__(self) -> str:
        machine_ms, bus_ms, computing_ms = (1e3 * time_s for time_s in self)
        return (
            f"late or interrupted for {machine_ms:.1f} ms, read the bus for {bus_ms:.1f} ms and computed for "
            f"{computing_ms:.1f} ms"
        )


_CAUSES: Final = CycleTimes._fields
_NAMES: Final = dict(zip(_CAUSES, ("the machine", "the bus", "computing"), strict=True))


class MissedCycles:
    """Missed cycles since the last report, and the durations of recent cycles. The loop thread adds the cycles."""

    def __init__(self) -> None:
        self._durations_s: deque[float] = deque(maxlen=REMEMBERED_CYCLES)
        self._reported_s = -math.inf
        self._forget()

    def _forget(self) -> None:
        self._cycles = self._missed = 0
        self._sums = CycleTimes(0.0, 0.0, 0.0)
        self._slowest = CycleTimes(0.0, 0.0, 0.0)

    def add(self, duration_s: float) -> None:
        """Add a cycle. ``duration_s`` is the time from the cycle's due time to its end, in seconds."""
        self._cycles += 1
        self._durations_s.append(duration_s)

    def miss(self, missed: int, times: CycleTimes) -> None:
        """Count the cycles that were missed because of the last added cycle, and add the ``times`` of that cycle."""
        self._missed += missed
        self._sums = CycleTimes(*map(sum, zip(self._sums, times, strict=True)))
        self._slowest = max(self._slowest, times, key=lambda one: one.total_s)

    def report(self, now_s: float, period_s: float) -> str:
        """Return a report about all cycles since the last report.

        Args:
            now_s: Current time, in seconds.
            period_s: Period of the loop, in seconds.

        Returns:
            The report, or an empty string if no cycle was missed or the last report was recent.
        """
        if not self._missed or now_s - self._reported_s < REPORT_AGAIN_S:
            return ""
        self._reported_s = now_s
        due = self._cycles + self._missed
        cause = max(zip(self._sums, _CAUSES, strict=True))[1]
        text = (
            f"missed {counted(self._missed, 'cycle')} of {due} at {1.0 / period_s:g} Hz ({self._missed / due:.2%}), "
            f"mostly because of {_NAMES[cause]}: the slowest cycle was {self._slowest}"
        )
        self._forget()
        kept_hz = self.kept_hz
        if kept_hz is None or kept_hz * period_s >= 1.0:
            return text
        return f"{text}. This machine recently sustained {kept_hz:g} Hz: set update_rate to {kept_hz:g} or less"

    @property
    def kept_hz(self) -> float | None:
        """Highest rate at which 99.5 % of the recent cycles are on time, in Hz; None if there have been too few cycles.

        Any thread may read this property.
        """
        durations_s = sorted(self._durations_s)
        if len(durations_s) < FEWEST_CYCLES:
            return None
        longest_s = durations_s[math.ceil(KEPT_SHARE * len(durations_s)) - 1]
        return _rounded_down(1.0 / longest_s) if longest_s > 0.0 else None


def _rounded_down(rate_hz: float) -> float:
    """Round a rate down to two significant digits."""
    digits = 10.0 ** (math.floor(math.log10(rate_hz)) - 1)
    return math.floor(rate_hz / digits + 1e-9) * digits
