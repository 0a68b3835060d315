"""Draw plots as SVG: time series, bars, histograms and points."""

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
"""Width of a figure, in inches."""
_STYLE: Final[dict[Any, Any]] = {
    # Unlike paths, text elements make files searchable and ten times smaller.
    "svg.fonttype": "none",
    # Without a salt, the names of markers and clip paths are random.
    "svg.hashsalt": "servoloop",
    "font.size": 9.0,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
}
PALETTE: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")
"""Okabe and Ito's color palette, which is suitable for color-blind readers."""
NO_METADATA: Final = {"Creator": None, "Date": None, "Format": None, "Type": None}


def style() -> AbstractContextManager[None]:
    """Return a context in which figures are drawn in servoloop's style."""
    return mpl.rc_context(_STYLE)


def new_figure(height_in: float) -> Figure:
    """Return an empty figure with a height in inches."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def svg(figure: Figure) -> str:
    """Return a figure as an ``<svg>`` element, without IDs that would be duplicated on a page with several figures."""
    text = io.StringIO()
    with style():
        figure.savefig(text, format="svg", metadata=NO_METADATA)
    element = text.getvalue().partition("<svg")[1:]
    return re.sub(r'<g id="[^"]*"', "<g", "".join(element)).strip()


PANEL_IN = 1.9
"""Height of a panel, in inches."""


@dataclass(frozen=True, slots=True)
class Curve:
    """Values over time. A NaN value leaves a gap in the curve. Curves with the same ``label`` share a color."""

    label: str
    values: Sequence[float]
    dashed: bool = False
    """Whether the curve is dashed. Commands are dashed."""


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves that share a unit."""

    unit: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Period that is shaded in all panels and labeled in the first panel."""

    label: str
    begin_s: float
    end_s: float


def time_series(
    times_s: Sequence[float], panels: Sequence[Panel], stretches: Sequence[Stretch] = (), mark_s: float | None = None
) -> str:
    """Return panels with a shared time axis as SVG.

    Args:
        times_s: Times of the values in all curves, in seconds.
        panels: Panels from top to bottom.
        stretches: Periods to shade.
        mark_s: Time to mark with a line, if any.
    """
    with style():
        figure = new_figure(0.8 + PANEL_IN * len(panels))
        every = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        colors: dict[str, str] = {}
        for axes, panel in zip(every, panels, strict=True):
            _draw(axes, times_s, panel, colors)
            _shade(axes, stretches, mark_s, named=axes is every[0])
        every[-1].set_xlabel("time (s)")
        named = {label: line for axes in every for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
        figure.legend(list(named.values()), list(named), loc="outside right upper", frameon=False)
        return svg(figure)


def _draw(axes: Axes, times_s: Sequence[float], panel: Panel, colors: dict[str, str]) -> None:
    for curve in panel.curves:
        color = colors.setdefault(curve.label, PALETTE[len(colors) % len(PALETTE)])
        # matplotlib hides labels that start with _ from the legend.
        label = f"_{curve.label}" if curve.dashed else curve.label
        # A command does not change until the next cycle, so commands are drawn as steps.
        (line,) = axes.plot(times_s, curve.values, color=color, linewidth=1.2, label=label)
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
"""Height of a bar, in inches."""


def stacked_bars(rows: Sequence[str], series: Mapping[str, Sequence[float]], colors: Sequence[str], unit: str) -> str:
    """Return stacked horizontal bars as SVG, one per row from top to bottom. Each series has one value per row."""
    with style():
        figure = new_figure(1.0 + ROW_IN * len(rows))
        axes = figure.add_subplot()
        left = [0.0] * len(rows)
        for (name, values), color in zip(series.items(), colors, strict=True):
            axes.barh(rows, values, left=left, label=name, color=color, height=0.7)
            left = [before + value for before, value in zip(left, values, strict=True)]
        axes.invert_yaxis()
        axes.set(xlabel=unit, xlim=(0.0, 1.05 * max(left, default=0.0) or 1.0))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(False, axis="y")
        figure.legend(loc="outside upper center", ncols=len(series), frameon=False)
        return svg(figure)


def histogram(
    edges: Sequence[float], series: Mapping[str, Sequence[float]], colors: Sequence[str], axis: str, unit: str
) -> str:
    """Return a stacked histogram as SVG. Each series contains a count for each interval between two ``edges``."""
    with style():
        figure = new_figure(2.2)
        axes = figure.add_subplot()
        widths = [end - begin for begin, end in pairwise(edges)]
        bottom = [0.0] * len(widths)
        for (name, values), color in zip(series.items(), colors, strict=True):
            axes.bar(edges[:-1], values, widths, bottom, align="edge", label=name, color=color, edgecolor="white")
            bottom = [before + value for before, value in zip(bottom, values, strict=True)]
        axes.set(xlabel=axis, ylabel=unit, xlim=(edges[0], edges[-1]), ylim=(0.0, 1.05 * max(bottom) or 1.0))
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(False, axis="x")
        return svg(figure)


Points = Sequence[tuple[float, float]]
MOST = 2000
"""Maximum number of points in a group. Larger groups show only the lowest and highest points of each interval."""


def points(groups: Mapping[str, Points], colors: Sequence[str], axis: str, unit: str) -> str:
    """Return groups of points (x, y) as SVG. Each x is an integer. Each y is in ``unit``, finite and not negative."""
    with style():
        figure = new_figure(2.6)
        axes = figure.add_subplot()
        for (name, group), color in zip(groups.items(), colors, strict=True):
            shown = thinned(group)
            axes.plot([x for x, _ in shown], [y for _, y in shown], ".", markersize=4, color=color, label=name)
        highest = max((y for group in groups.values() for _, y in group), default=0.0)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel=axis, ylabel=unit, ylim=(0.0, 1.08 * highest or 1.0))
        return svg(figure)


def thinned(group: Points) -> Points:
    """Return at most ``MOST`` points, reduced to the lowest and highest points of each interval of x if necessary."""
    if len(group) <= MOST:
        return group
    ordered = sorted(group)
    size = -(-len(ordered) // (MOST // 2))
    stretches = [ordered[at : at + size] for at in range(0, len(ordered), size)]
    kept = {pick(stretch, key=lambda point: point[1]) for stretch in stretches for pick in (min, max)}
    return sorted(kept)
