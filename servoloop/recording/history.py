"""Keep the joint values of the last minute for plots."""

from collections import deque
from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from servoloop.recording.joint_values import widened

KEPT_S: Final = 60.0


class HistoryRow(NamedTuple):
    """Joint values of one cycle: arrays (n,) in joint order, in rad or m, rad/s or m/s, and N m or N."""

    stamp_s: float
    position: FloatArray
    command: FloatArray
    """Commanded positions, or NaN for joints without a command."""
    velocity: FloatArray
    effort: FloatArray


class Curves(NamedTuple):
    """Joint values of the last minute: times (k,) in seconds, and arrays (k, n) in the units of HistoryRow."""

    time_s: FloatArray
    position: FloatArray
    command: FloatArray
    velocity: FloatArray
    effort: FloatArray

    @property
    def error(self) -> FloatArray:
        """Command minus position, (k, n)."""
        return self.command - self.position


class History:
    """Rows of the last ``KEPT_S`` seconds. Not thread-safe."""

    def __init__(self) -> None:
        self._rows: deque[HistoryRow] = deque()

    def add(self, row: HistoryRow) -> None:
        """Add a row. If the new row is older than the last row, start a new history.

        If the row contains a new joint, NaN is added to earlier rows for this joint.
        """
        rows = self._rows
        if rows and len(rows[-1].position) < len(row.position):
            rows = self._rows = deque(_widened(each, len(row.position)) for each in rows)
        if rows and row.stamp_s < rows[-1].stamp_s:
            rows.clear()
        rows.append(row)
        while row.stamp_s - rows[0].stamp_s > KEPT_S:
            rows.popleft()

    def curves(self) -> Curves:
        """Return all rows as arrays."""
        if not self._rows:
            empty = np.empty((0, 0))
            return Curves(np.empty(0), empty, empty, empty, empty)
        time_s, *columns = zip(*self._rows, strict=True)
        return Curves(np.array(time_s), *(np.array(column) for column in columns))


def _widened(row: HistoryRow, count: int) -> HistoryRow:
    return HistoryRow(row.stamp_s, *(widened(values, count) for values in row[1:]))
