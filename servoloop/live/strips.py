"""Strips: the numbers of one joint over the last minute, as plots draw them."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from servoloop.live.watched import Health, Minute, health_column

MOST: Final = 600
"""Points in a strip; of more every so many-th is shown."""


class Strip(NamedTuple):
    """A plot: its title, and the numbers in it."""

    title: str
    columns: tuple[str, ...]
    least: float
    """The smallest range of its axis: what is less is noise."""


STRIPS: Final = (
    Strip("position, command (rad, m)", ("position", "command"), 0.02),
    Strip("error (rad, m)", ("error",), 0.002),
    Strip("velocity (1/s)", ("velocity",), 0.1),
    Strip("load (N m, N)", ("effort",), 0.5),
    Strip("voltage (V)", ("voltage_v",), 2.0),
    Strip("temperature (°C)", ("temperature_c",), 10.0),
)


def strip_data(minute: Minute, columns: Sequence[str], place: int) -> tuple[FloatArray, ...]:
    """Seconds before the newest cycle, and for each column its numbers of the joint at ``place``."""
    curves, rows = minute
    if columns[0] in Health._fields:
        times = np.array([row.stamp_s for row in rows])
        values = [health_column(rows, name, place) for name in columns]
    else:
        times, values = curves.time_s, [_column(getattr(curves, name), place) for name in columns]
    if not len(times):
        return tuple(np.zeros(1) for _ in range(len(columns) + 1))
    step = -(-len(times) // MOST)
    now = max([*curves.time_s[-1:], times[-1]])
    return times[::step] - now, *(column[::step] for column in values)


def axis_range(columns: Sequence[FloatArray], least: float) -> tuple[float, float]:
    """The range of an axis: all numbers that are there, at least ``least``, in steps so that it seldom changes."""
    values = np.concatenate(columns)
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    step = 2.0 ** math.ceil(math.log2(max(high - low, least) / 4.0))
    return math.floor(low / step - 0.25) * step, math.ceil(high / step + 0.25) * step


def _column(values: FloatArray, place: int) -> FloatArray:
    """A column of (m, n), none where nothing has been measured."""
    return values[:, place] if values.size else np.empty(0)
