"""Time series of joints: panels below each other on one time axis, with moments and stretches of time marked."""

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

WIDTH_IN: Final = 9.0
"""Inches of 72 points; a page shows a figure as wide as itself."""
_STYLE: Final[dict[Any, Any]] = {
    # text stays text: a tenth of the size, and it can be searched
    "svg.fonttype": "none",
    # names of markers and clip paths come from their content and this, else from a random number
    "svg.hashsalt": "servoloop",
    "font.size": 9.0,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
}
PALETTE: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")
"""Okabe and Ito's colours, which colour-blind people tell apart too."""
NO_METADATA: Final = {"Creator": None, "Date": None, "Format": None, "Type": None}


def style() -> AbstractContextManager[None]:
    """What a figure of ours looks like; it is drawn within this context."""
    return mpl.rc_context(_STYLE)


def new_figure(height_in: float) -> Figure:
    """An empty figure, ``height_in`` inches high."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def svg(figure: Figure) -> str:
    """The figure as an ``<svg>`` element, without names that would stand twice in a page with several."""
    text = io.StringIO()
    with style():
        figure.savefig(text, format="svg", metadata=NO_METADATA)
    element = text.getvalue().partition("<svg")[1:]
    return re.sub(r'<g id="[^"]*"', "<g", "".join(element)).strip()


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


ROW_IN = 0.2
"""Inches that a bar takes."""


def stacked_bars(rows: Sequence[str], series: Mapping[str, Sequence[float]], colours: Sequence[str], unit: str) -> str:
    """Bars as SVG, one for each of ``rows`` from top to bottom; ``series``: a number for each row, by name."""
    with style():
        figure = new_figure(1.0 + ROW_IN * len(rows))
        axes = figure.add_subplot()
        left = [0.0] * len(rows)
        for (name, values), colour in zip(series.items(), colours, strict=True):
            axes.barh(rows, values, left=left, label=name, color=colour, height=0.7)
            left = [before + value for before, value in zip(left, values, strict=True)]
        axes.invert_yaxis()
        axes.set(xlabel=unit, xlim=(0.0, 1.05 * max(left, default=0.0) or 1.0))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(False, axis="y")
        figure.legend(loc="outside upper center", ncols=len(series), frameon=False)
        return svg(figure)


def histogram(
    edges: Sequence[float], series: Mapping[str, Sequence[float]], colours: Sequence[str], axis: str, unit: str
) -> str:
    """Stacked counts between ``edges`` as SVG; ``series``: a number for each gap between two edges, by name."""
    with style():
        figure = new_figure(2.2)
        axes = figure.add_subplot()
        widths = [end - begin for begin, end in pairwise(edges)]
        bottom = [0.0] * len(widths)
        for (name, values), colour in zip(series.items(), colours, strict=True):
            axes.bar(edges[:-1], values, widths, bottom, align="edge", label=name, color=colour, edgecolor="white")
            bottom = [before + value for before, value in zip(bottom, values, strict=True)]
        axes.set(xlabel=axis, ylabel=unit, xlim=(edges[0], edges[-1]), ylim=(0.0, 1.05 * max(bottom) or 1.0))
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(False, axis="x")
        return svg(figure)


Points = Sequence[tuple[float, float]]
MOST = 2000
"""Points of a group; of more, only the lowest and the highest of each stretch are shown."""


def points(groups: Mapping[str, Points], colours: Sequence[str], axis: str, unit: str) -> str:
    """Points (x, y) as SVG, by the name of their group; x a whole number, y in ``unit``, finite and not negative."""
    with style():
        figure = new_figure(2.6)
        axes = figure.add_subplot()
        for (name, group), colour in zip(groups.items(), colours, strict=True):
            shown = thinned(group)
            axes.plot([x for x, _ in shown], [y for _, y in shown], ".", markersize=4, color=colour, label=name)
        highest = max((y for group in groups.values() for _, y in group), default=0.0)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel=axis, ylabel=unit, ylim=(0.0, 1.08 * highest or 1.0))
        return svg(figure)


def thinned(group: Points) -> Points:
    """At most ``MOST`` points: the lowest and the highest of each stretch of x, where there are more."""
    if len(group) <= MOST:
        return group
    ordered = sorted(group)
    size = -(-len(ordered) // (MOST // 2))
    stretches = [ordered[at : at + size] for at in range(0, len(ordered), size)]
    kept = {pick(stretch, key=lambda point: point[1]) for stretch in stretches for pick in (min, max)}
    return sorted(kept)
