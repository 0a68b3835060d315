"""A figure of matplotlib as an SVG element that can stand in a page: without a window, a network or the time of day."""

import io
import re
from contextlib import AbstractContextManager
from typing import Any, Final

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

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
