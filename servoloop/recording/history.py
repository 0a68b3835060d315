"""The last minute of a robot's numbers, for plots."""

from collections import deque
from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from servoloop.recording.joint_values import widened

KEPT_S: Final = 60.0


class Row(NamedTuple):
    """The numbers of one cycle; arrays (n,) in the order of the joints, rad or m, per second, N m or N."""

    stamp_s: float
    position: FloatArray
    command: FloatArray
    """NaN where none is commanded."""
    velocity: FloatArray
    effort: FloatArray


class Curves(NamedTuple):
    """The numbers of the last minute: times (k,) in s, arrays (k, n)."""

    time_s: FloatArray
    position: FloatArray
    command: FloatArray
    velocity: FloatArray
    effort: FloatArray

    @property
    def error(self) -> FloatArray:
        """Command less position, (k, n)."""
        return self.command - self.position


class History:
    """Rows of the last ``KEPT_S`` seconds, of one thread."""

    def __init__(self) -> None:
        self._rows: deque[Row] = deque()

    def add(self, row: Row) -> None:
        """Keep a row; time that goes back begins a new history. Rows from before a joint came have NaN for it."""
        rows = self._rows
        if rows and len(rows[-1].position) < len(row.position):
            rows = self._rows = deque(_widened(each, len(row.position)) for each in rows)
        if rows and row.stamp_s < rows[-1].stamp_s:
            rows.clear()
        rows.append(row)
        while row.stamp_s - rows[0].stamp_s > KEPT_S:
            rows.popleft()

    def curves(self) -> Curves:
        """All rows as arrays."""
        if not self._rows:
            empty = np.empty((0, 0))
            return Curves(np.empty(0), empty, empty, empty, empty)
        time_s, *columns = zip(*self._rows, strict=True)
        return Curves(np.array(time_s), *(np.array(column) for column in columns))


def _widened(row: Row, count: int) -> Row:
    return Row(row.stamp_s, *(widened(values, count) for values in row[1:]))
