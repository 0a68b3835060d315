"""Plot of ``servoloop tune``. The plot requires the ``report`` extra."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from matplotlib.axes import Axes

from commissioning.tune.figures import TuneTrace
from commissioning.tune.report import TuneReport
from commissioning.tune.tuner import Measurement
from hal.types import FloatArray
from servoloop.plots import PALETTE, new_figure, style, svg

HEIGHT_IN = 5.0


class _Curves(NamedTuple):
    """Curves of one motion, measured with one set of gains."""

    label: str
    color: str
    trace: TuneTrace


def picture(report: TuneReport) -> str:
    """Return an SVG plot with positions at the top and errors at the bottom, in encoder counts."""
    measured = [one for one in (report.before, report.after) if one is not None]
    columns = [
        ("step away", [one.steps[0] for one in measured]),
        ("step back", [one.steps[1] for one in measured]),
        (f"sine, {report.before.plan.sine_hz:.2g} Hz", [one.sine for one in measured]),
    ]
    with style():
        figure = new_figure(HEIGHT_IN)
        axes = figure.subplots(2, len(columns), sharex="col", sharey="row")
        for at, (title, traces) in enumerate(columns):
            curves = list(_curves(measured, traces))
            _draw(axes[0, at], axes[1, at], curves, report.count)
            axes[0, at].set_title(title)
        axes[0, 0].set_ylabel(f"{report.joint.name} ({report.unit})\ndashed: command")
        axes[1, 0].set_ylabel("command − position (counts)")
        for below in axes[1]:
            below.set_xlabel("time (s)")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)
        return svg(figure)


def _curves(measured: Sequence[Measurement], traces: Sequence[TuneTrace]) -> Iterator[_Curves]:
    for one, trace, color in zip(measured, traces, PALETTE, strict=False):
        words = ", ".join(f"{letter} {one.gains[letter]}" for letter in "PDI" if letter in one.gains)
        yield _Curves(words or "measured", color, trace)


def _draw(above: Axes, below: Axes, curves: Sequence[_Curves], count: float) -> None:
    first = curves[0].trace
    above.plot(first.time_s, first.command, color="black", linestyle="--", linewidth=0.9)
    for label, color, trace in curves:
        above.plot(trace.time_s, trace.position, color=color, linewidth=1.2, label=label)
        error: FloatArray = (trace.command - trace.position) / count
        below.plot(trace.time_s, error, color=color, linewidth=1.2)
