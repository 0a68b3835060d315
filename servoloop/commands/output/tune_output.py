"""Output of ``servoloop tune``: the table of results and the text below it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import yaml
from rich.table import Table

from commissioning.tune.figures import JointFigures
from commissioning.tune.predict import Predicted
from commissioning.tune.report import TuneReport


class _Row(NamedTuple):
    """Row of the table: its name, the field of ``JointFigures`` and ``Predicted`` that it shows, and whether this value
    is a time."""

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
    """Return a table of the results: before the change, as predicted, and after the change."""
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
        yield f"To try these gains, use --write {wanted} (or --apply). Their results are predicted, not measured."
    for one in report.written:
        yield f"servo {joint.servo_id}: {one.gain} ({one.register}) changed from {one.old} to {one.new}"
    if report.to_keep:
        yield f"To keep the gains, add to {robot_file} under joints, {joint.name}: {_flow(report.to_keep)}"
    if report.written and not report.to_keep:
        yield "These gains are lost at power-off: they are in the servo's RAM, and the robot file cannot set them."
    if report.overruled and not report.to_keep:
        yield f"{robot_file} sets {_flow(report.overruled)}, which `servoloop up` writes to the servo."


def _flow(values: object) -> str:
    """Return the values as YAML on one line."""
    return yaml.safe_dump(values, default_flow_style=True, sort_keys=False, width=1000).strip()[1:-1]
