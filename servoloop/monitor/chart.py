"""A plot of lines in characters: each one has two columns and four rows of dots."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray

BLANK: Final = 0x2800
"""The braille character without dots;"""
DOTS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""what each dot adds to it."""
ROWS, COLUMNS = DOTS.shape
Range = tuple[float, float]
Characters = NDArray[np.int_]


def chart(x: FloatArray, y: FloatArray, range_x: Range, range_y: Range, width: int, height: int) -> Characters:
    """The characters (height, width) of a line through the points (k,); NaN interrupts it, what is outside is left out.

    The top row is the end of ``range_y``.
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
    """The values in dots from the lower limit."""
    low, high = limits
    return (values - low) / (high - low) * (dots - 1)


def _line(x: FloatArray, y: FloatArray) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """The dots of a line through points in dots; two points are joined without a gap."""
    there = np.isfinite(x) & np.isfinite(y)
    both = there[:-1] & there[1:]
    dx, dy = np.diff(x)[both], np.diff(y)[both]
    steps = np.ceil(np.maximum(np.abs(dx), np.abs(dy))).astype(int) + 1
    first = np.cumsum(steps) - steps
    share = (np.arange(steps.sum()) - np.repeat(first, steps)) / np.repeat(steps, steps)
    across = np.concatenate([x[there], np.repeat(x[:-1][both], steps) + share * np.repeat(dx, steps)])
    down = np.concatenate([y[there], np.repeat(y[:-1][both], steps) + share * np.repeat(dy, steps)])
    return np.rint(across).astype(int), np.rint(down).astype(int)
