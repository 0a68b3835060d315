"""Strips: the numbers of one joint over the last minute."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import viser
import viser.uplot as uplot

from hal.types import FloatArray
from servoloop.view.state import HISTORY_S, Sample, column

HEIGHT_PX: Final = 110
MOST: Final = 600
"""Points in a strip; of more every so many-th is shown."""


class Strip(NamedTuple):
    """A plot: its title, and the numbers of a sample in it."""

    title: str
    columns: tuple[str, ...]


STRIPS: Final = (
    Strip("position, command (rad, m)", ("position", "command")),
    Strip("error (rad, m)", ("error",)),
    Strip("velocity (1/s)", ("velocity",)),
    Strip("load (N m, N)", ("effort",)),
    Strip("voltage (V)", ("voltage_v",)),
    Strip("temperature (°C)", ("temperature_c",)),
)
COLOURS: Final = ("#d2522d", "#4682dc")


def strip_data(samples: Sequence[Sample], columns: Sequence[str], place: int) -> tuple[FloatArray, ...]:
    """Seconds before the newest sample, and for each column its numbers of the joint at ``place``."""
    if not samples:
        return tuple(np.zeros(1) for _ in range(len(columns) + 1))
    step = max(1, -(-len(samples) // MOST))
    chosen = samples[::-step][::-1]
    times = np.array([sample.time_s for sample in chosen]) - samples[-1].time_s
    return times, *(column(chosen, name, place) for name in columns)


class Strips:
    """The plots in the page."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._plots = [self._add(server, strip) for strip in STRIPS]

    def show(self, samples: Sequence[Sample], place: int) -> None:
        """Draw the joint at ``place``."""
        for strip, plot in zip(STRIPS, self._plots, strict=True):
            plot.data = strip_data(samples, strip.columns, place)

    def _add(self, server: viser.ViserServer, strip: Strip) -> viser.GuiUplotHandle:
        axes: Any = (uplot.Axis(size=22), uplot.Axis(size=52))
        return server.gui.add_uplot(
            strip_data((), strip.columns, 0),
            (
                uplot.Series(label="s"),
                *(
                    uplot.Series(label=name, stroke=colour, width=1.5)
                    for name, colour in zip(strip.columns, COLOURS, strict=False)
                ),
            ),
            title=strip.title,
            scales={"x": uplot.Scale(time=False, auto=False, min=-HISTORY_S, max=0.0)},
            axes=axes,
            legend=uplot.Legend(show=False),
            height=HEIGHT_PX,
        )
