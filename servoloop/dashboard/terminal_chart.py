"""Plot in the terminal, drawn with braille characters: a title with the latest values, an axis and the curves."""

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.text import Text
from textual.widgets import Static

from hal.types import FloatArray
from servoloop.dashboard.tables import Strip, axis_range, strip_data
from servoloop.recording.history import KEPT_S
from servoloop.recording.robot_state import Minute

BLANK: Final = 0x2800
"""Code point of the braille character without dots."""
DOTS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Value that each dot adds to the code point."""
ROWS, COLUMNS = DOTS.shape
Range = tuple[float, float]
Characters = NDArray[np.int_]


def chart(x: FloatArray, y: FloatArray, range_x: Range, range_y: Range, width: int, height: int) -> Characters:
    """Return the characters (height, width) that draw a line through points (k,).

    NaN interrupts the line, and segments outside the ranges are omitted. The top row is the upper end of ``range_y``.
    """
    across = _scaled(x, range_x, width * COLUMNS)
    down = height * ROWS - 1 - _scaled(y, range_y, height * ROWS)
    column, row = _line(across, down)
    seen = (column >= 0) & (column < width * COLUMNS) & (row >= 0) & (row < height * ROWS)
    dots = np.zeros((height * ROWS, width * COLUMNS), dtype=bool)
    dots[row[seen], column[seen]] = True
    cells = dots.reshape(height, ROWS, width, COLUMNS)
    return np.asarray(BLANK + np.einsum("hrwc,rc->hw", cells, DOTS))


def _scaled(values: FloatArray, limits: Range, dots: int) -> FloatArray:
    """Convert values to numbers of dots above the lower limit."""
    low, high = limits
    return (values - low) / (high - low) * (dots - 1)


def _line(x: FloatArray, y: FloatArray) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the dots of a continuous line through points in dot coordinates."""
    there = np.isfinite(x) & np.isfinite(y)
    both = there[:-1] & there[1:]
    dx, dy = np.diff(x)[both], np.diff(y)[both]
    steps = np.ceil(np.maximum(np.abs(dx), np.abs(dy))).astype(int) + 1
    first = np.cumsum(steps) - steps
    share = (np.arange(steps.sum()) - np.repeat(first, steps)) / np.repeat(steps, steps)
    across = np.concatenate([x[there], np.repeat(x[:-1][both], steps) + share * np.repeat(dx, steps)])
    down = np.concatenate([y[there], np.repeat(y[:-1][both], steps) + share * np.repeat(dy, steps)])
    return np.rint(across).astype(int), np.rint(down).astype(int)


COLORS: Final = ("bright_red", "bright_blue")
"""Color of the first line, which is in front, and color of the second line."""
AXIS: Final = 9
"""Width of the axis, in columns."""


class StripChart(Static):
    """Plot of the last minute of one joint."""

    def __init__(self, strip: Strip) -> None:
        super().__init__(classes="strip")
        self.strip = strip

    def show(self, minute: Minute, place: int) -> None:
        """Plot the joint with index ``place``."""
        times, *columns = strip_data(minute, self.strip.columns, place)
        width, height = self.size.width - AXIS, self.size.height - 1
        lines = [self._title(columns)]
        if width > 0 and height > 0:
            limits = axis_range(columns, self.strip.least)
            drawn = [chart(times, column, (-KEPT_S, 0.0), limits, width, height) for column in columns]
            ends = {0: limits[1], height - 1: limits[0]}
            lines += [
                Text.assemble((f"{ends[row]:8.3g} " if row in ends else " " * AXIS, "dim"), _row(row, drawn))
                for row in range(height)
            ]
        self.update(Text("\n").join(lines), layout=False)  # the style sheet sets the size

    def _title(self, columns: Sequence[FloatArray]) -> Text:
        title = Text(self.strip.title, style="bold")
        for values, color in zip(columns, COLORS, strict=False):
            newest = float(values[-1])
            title.append("  –" if math.isnan(newest) else f"  {newest:.4g}", style=color)
        return title


def _row(row: int, drawn: Sequence[Characters]) -> Text:
    """Return a row of the plot. A character shared by two lines has the color of the line in front."""
    cells = np.array([one[row] for one in drawn])
    dots = np.bitwise_or.reduce(cells)
    front = np.argmax(cells != BLANK, axis=0)
    text = Text()
    for color, places in groupby(range(len(dots)), key=lambda place: COLORS[front[place]]):
        text.append("".join(chr(dots[place]) for place in places), style=color)
    return text
