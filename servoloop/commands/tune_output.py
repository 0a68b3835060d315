"""Output of ``servoloop tune``: the table of figures, the text below it, and the plot."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import yaml
from matplotlib.axes import Axes
from rich.table import Table

from commissioning.tune.figures import JointFigures, TuneTrace
from commissioning.tune.predict import Predicted
from commissioning.tune.report import TuneReport
from commissioning.tune.tuner import Measurement
from hal.types import FloatArray
from servoloop.plots import PALETTE, new_figure, style, svg


class _Row(NamedTuple):
    """Row of the table: its name, its field in ``JointFigures`` and ``Predicted``, and whether it is a time."""

    name: str
    field: str
    is_time: bool = False


ROWS: Final = (
    _Row("overshoot", "overshoot"),
    _Row("settling time", "settling_s", True),
    _Row("sag at rest", "sag"),
    _Row("variation of the sag (±)", "stick"),
    _Row("largest error at rest", "rest_error"),
    _Row("delay", "delay_s", True),
    _Row("largest error in the sine", "following_largest"),
    _Row("RMS error in the sine", "following_rms"),
    _Row("oscillation at rest", "swing"),
)


def table(report: TuneReport) -> Table:
    """Return a table of the figures before, as predicted and after."""
    shown: list[tuple[str, JointFigures | Predicted]] = [(_gains(report.before.gains), report.before.figures)]
    if report.predicted is not None:
        values = {one.gain: one.new for one in report.written} or dict(report.proposal.values)
        shown.append((f"predicted for\n{_gains(values)}", report.predicted))
    if report.after is not None:
        shown.append((_gains(report.after.gains), report.after.figures))
    joint = report.joint
    made = Table(title=f"{joint.name} (servo {joint.servo_id}, {joint.model.name}): {report.unit}, (counts), ms")
    made.add_column("")
    for heading, _ in shown:
        made.add_column(heading, justify="right")
    in_position, in_time = _position(report), _time
    for row in ROWS:
        write = in_time if row.is_time else in_position
        made.add_row(row.name, *(write(found, row.field) for _, found in shown))
    made.add_row("oscillates at rest", *(_shakes(found) for _, found in shown))
    return made


def _gains(gains: object) -> str:
    assert isinstance(gains, dict)
    return " ".join(f"{name} {value}" for name, value in gains.items() if len(name) == 1 or len(gains) == 1)


def _position(report: TuneReport) -> Callable[[JointFigures | Predicted, str], str]:
    def write(found: JointFigures | Predicted, field: str) -> str:
        value = getattr(found, field, None)
        if value is None:
            return ""
        most = "at most " if isinstance(found, Predicted) and field == "overshoot" and found.overshoot_at_most else ""
        return f"{most}{value:.4f} ({value / report.count:.1f})"

    return write


def _time(found: JointFigures | Predicted, field: str) -> str:
    if isinstance(found, JointFigures) and getattr(found, field) is None:
        return "does not settle" if field == "settling_s" else "none"
    value = getattr(found, field, None)
    return "" if value is None else f"{value * 1e3:.0f} ms"


def _shakes(found: JointFigures | Predicted) -> str:
    if isinstance(found, Predicted):
        return "not predicted"
    return f"yes, {found.swing_hz:.1f} Hz" if found.shakes else "no"


def words(report: TuneReport, robot_file: Path) -> Iterator[str]:
    """Yield the lines below the table."""
    proposal, joint = report.proposal, report.joint
    yield from (f"· {reason}" for reason in proposal.reasons)
    wanted = " ".join(f"{name}={value}" for name, value in proposal.values.items())
    if wanted and not report.written:
        yield f"To try these gains, use --write {wanted} (or --apply). Their figures are predicted, not measured."
    for one in report.written:
        yield f"servo {joint.servo_id}: {one.gain} ({one.register}) changed from {one.old} to {one.new}"
    if report.to_keep:
        yield f"To keep the gains, add to {robot_file} under joints, {joint.name}: {_flow(report.to_keep)}"
    if report.written and not report.to_keep:
        yield "These gains are lost at power-off: they are in the servo's RAM, and the robot file cannot set them."
    if report.overruled and not report.to_keep:
        yield f"{robot_file} sets {_flow(report.overruled)}, which `servoloop up` writes to the servo."


def _flow(values: object) -> str:
    """Return the values as YAML in one line."""
    return yaml.safe_dump(values, default_flow_style=True, sort_keys=False, width=1000).strip()[1:-1]


HEIGHT_IN = 5.0


class _Curves(NamedTuple):
    """Curves of one motion, measured with one set of gains."""

    label: str
    color: str
    trace: TuneTrace


def picture(report: TuneReport) -> str:
    """Return an SVG plot with positions above and errors, in encoder counts, below."""
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
