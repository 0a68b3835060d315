"""The strips in the page: the numbers of one joint over the last minute."""

from typing import Any, Final

import viser
import viser.uplot as uplot

from servoloop.live.history import KEPT_S
from servoloop.live.strips import STRIPS, Strip, axis_range, strip_data
from servoloop.live.watched import Watched

HEIGHT_PX: Final = 150
COLOURS: Final = ("#d2522d", "#4682dc")


class Strips:
    """The plots in the page."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._plots = [self._add(server, strip) for strip in STRIPS]

    def show(self, watched: Watched, place: int) -> None:
        """Draw the joint at ``place``."""
        minute = watched.minute()
        for strip, plot in zip(STRIPS, self._plots, strict=True):
            data = strip_data(minute, strip.columns, place)
            scales = _scales(axis_range(data[1:], strip.least))
            if scales != plot.scales:  # the plot is made anew
                plot.scales = scales
            plot.data = data

    def _add(self, server: viser.ViserServer, strip: Strip) -> viser.GuiUplotHandle:
        axes: Any = (uplot.Axis(size=30), uplot.Axis(size=52))
        return server.gui.add_uplot(
            strip_data(Watched().minute(), strip.columns, 0),
            (
                uplot.Series(label="s"),
                *(
                    uplot.Series(label=name, stroke=colour, width=1.5)
                    for name, colour in zip(strip.columns, COLOURS, strict=False)
                ),
            ),
            title=strip.title,
            scales=_scales((0.0, strip.least)),
            axes=axes,
            legend=uplot.Legend(show=False),
            height=HEIGHT_PX,
        )


def _scales(range_y: tuple[float, float]) -> dict[str, uplot.Scale]:
    return {"x": uplot.Scale(time=False, range=(-KEPT_S, 0.0)), "y": uplot.Scale(range=range_y)}
