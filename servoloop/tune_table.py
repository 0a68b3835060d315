"""The figures of a tuning for people, as a table, and the sentences below it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import yaml
from rich.table import Table

from commissioning.tune.figures import Figures
from commissioning.tune.law import Predicted
from commissioning.tune.report import Report


class _Row(NamedTuple):
    """A figure: where it stands in what was measured and predicted, and whether it is a time."""

    name: str
    field: str
    is_time: bool = False


ROWS: Final = (
    _Row("overshoot", "overshoot"),
    _Row("settles after", "settling_s", True),
    _Row("sag at rest", "sag"),
    _Row("to either side of it", "stick"),
    _Row("largest error at rest", "rest_error"),
    _Row("delay", "delay_s", True),
    _Row("largest error in the sine", "following_largest"),
    _Row("its RMS", "following_rms"),
    _Row("swing at rest", "swing"),
)


def table(report: Report) -> Table:
    """The figures before, as predicted, and after."""
    shown: list[tuple[str, Figures | Predicted]] = [(_gains(report.before.gains), report.before.figures)]
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
    made.add_row("shakes at rest", *(_shakes(found) for _, found in shown))
    return made


def _gains(gains: object) -> str:
    assert isinstance(gains, dict)
    return " ".join(f"{name} {value}" for name, value in gains.items() if len(name) == 1 or len(gains) == 1)


def _position(report: Report) -> Callable[[Figures | Predicted, str], str]:
    def write(found: Figures | Predicted, field: str) -> str:
        value = getattr(found, field, None)
        if value is None:
            return ""
        most = "at most " if isinstance(found, Predicted) and field == "overshoot" and found.overshoot_at_most else ""
        return f"{most}{value:.4f} ({value / report.count:.1f})"

    return write


def _time(found: Figures | Predicted, field: str) -> str:
    if isinstance(found, Figures) and getattr(found, field) is None:
        return "does not"
    value = getattr(found, field, None)
    return "" if value is None else f"{value * 1e3:.0f} ms"


def _shakes(found: Figures | Predicted) -> str:
    if isinstance(found, Predicted):
        return "measure"
    return f"yes, {found.swing_hz:.1f} Hz" if found.shakes else "no"


def words(report: Report, robot_file: Path) -> Iterator[str]:
    """The sentences below the table."""
    proposal, joint = report.proposal, report.joint
    yield from (f"· {reason}" for reason in proposal.reasons)
    wanted = " ".join(f"{name}={value}" for name, value in proposal.values.items())
    if wanted and not report.written:
        yield f"to try: --write {wanted} (or --apply). What it says of them is predicted, not measured"
    for one in report.written:
        yield f"servo {joint.servo_id}: {one.gain} ({one.register}) was {one.old}, is {one.new}"
    if report.to_keep:
        yield f"to keep it, in {robot_file} under joints, {joint.name}: {_flow(report.to_keep)}"
    if report.written and not report.to_keep:
        yield "it is gone with the power: these gains live in the servo's RAM, and no robot file names them"
    if report.overruled and not report.to_keep:
        yield f"{robot_file} names {_flow(report.overruled)}: `servoloop up` writes that to the servo"


def _flow(values: object) -> str:
    """YAML in one line."""
    return yaml.safe_dump(values, default_flow_style=True, sort_keys=False, width=1000).strip()[1:-1]
