"""A strip in the terminal: the title with the newest numbers, and below it their lines with the axis' ends."""

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Final

import numpy as np
from rich.text import Text
from textual.widgets import Static

from hal.types import FloatArray
from servoloop.live.history import KEPT_S
from servoloop.live.strips import Strip, axis_range, strip_data
from servoloop.live.watched import Minute
from servoloop.monitor.chart import BLANK, Characters, chart

COLOURS: Final = ("bright_red", "bright_blue")
"""Of the first line, which is in front, and of the second."""
AXIS: Final = 9
"""Columns that the axis takes."""


class StripChart(Static):
    """The last minute of one joint's numbers."""

    def __init__(self, strip: Strip) -> None:
        super().__init__(classes="strip")
        self.strip = strip

    def show(self, minute: Minute, place: int) -> None:
        """Draw the joint at ``place``."""
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
        self.update(Text("\n").join(lines), layout=False)  # its size is the style sheet's

    def _title(self, columns: Sequence[FloatArray]) -> Text:
        title = Text(self.strip.title, style="bold")
        for values, colour in zip(columns, COLOURS, strict=False):
            newest = float(values[-1])
            title.append("  –" if math.isnan(newest) else f"  {newest:.4g}", style=colour)
        return title


def _row(row: int, drawn: Sequence[Characters]) -> Text:
    """A row of all lines; where two meet in a character, it has the colour of the one in front."""
    cells = np.array([one[row] for one in drawn])
    dots = np.bitwise_or.reduce(cells)
    front = np.argmax(cells != BLANK, axis=0)
    text = Text()
    for colour, places in groupby(range(len(dots)), key=lambda place: COLOURS[front[place]]):
        text.append("".join(chr(dots[place]) for place in places), style=colour)
    return text
