"""Stacked bars: how often each of several things happened, by what came of it."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

from matplotlib.ticker import MaxNLocator

from servoloop.plots.svg import new_figure, style, svg

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
