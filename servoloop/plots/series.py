"""Time series of joints: panels below each other on one time axis, with moments and stretches of time marked."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes

from servoloop.plots.svg import PALETTE, new_figure, style, svg

PANEL_IN = 1.9
"""Inches that a panel takes."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve is one number over the panel's time; NaN leaves a gap. Curves of one ``label`` share a colour."""

    label: str
    values: Sequence[float]
    dashed: bool = False
    """For what was wanted, beside what was."""


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves with one unit."""

    unit: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of time is shaded in all panels, and named in the first."""

    label: str
    begin_s: float
    end_s: float


def time_series(
    times_s: Sequence[float], panels: Sequence[Panel], stretches: Sequence[Stretch] = (), mark_s: float | None = None
) -> str:
    """The panels as SVG; all curves have a value for each of ``times_s``. ``mark_s``: the moment to look at."""
    with style():
        figure = new_figure(0.8 + PANEL_IN * len(panels))
        every = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        colours: dict[str, str] = {}
        for axes, panel in zip(every, panels, strict=True):
            _draw(axes, times_s, panel, colours)
            _shade(axes, stretches, mark_s, named=axes is every[0])
        every[-1].set_xlabel("time (s)")
        named = {label: line for axes in every for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
        figure.legend(list(named.values()), list(named), loc="outside right upper", frameon=False)
        return svg(figure)


def _draw(axes: Axes, times_s: Sequence[float], panel: Panel, colours: dict[str, str]) -> None:
    for curve in panel.curves:
        colour = colours.setdefault(curve.label, PALETTE[len(colours) % len(PALETTE)])
        label = f"_{curve.label}" if curve.dashed else curve.label  # matplotlib's legend leaves such names out
        # What is wanted holds until the next cycle; what was measured went on between two cycles.
        (line,) = axes.plot(times_s, curve.values, color=colour, linewidth=1.2, label=label)
        if curve.dashed:
            line.set(linestyle="--", drawstyle="steps-post")
        else:
            line.set(marker=".", markersize=3)
    axes.set_ylabel(panel.unit)


def _shade(axes: Axes, stretches: Sequence[Stretch], mark_s: float | None, named: bool) -> None:
    for row, stretch in enumerate(stretches):
        axes.axvspan(stretch.begin_s, stretch.end_s, color="#d55e00", alpha=0.12, linewidth=0)
        if named:
            place = (stretch.begin_s, 1.0 - 0.12 * (row % 6))
            axes.annotate(
                stretch.label, place, xycoords=("data", "axes fraction"), va="top", fontsize=7, annotation_clip=False
            )
    if mark_s is not None:
        axes.axvline(mark_s, color="#b00020", linewidth=1.2)
