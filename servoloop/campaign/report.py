"""Write the report of a campaign: one HTML page with plots and no scripts. Identical runs produce identical pages."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from commissioning.atomic_write import write_file
from hal.joint import Joint
from servoloop.campaign.campaign import files_of
from servoloop.campaign.kept_violation import BEFORE_S, KeptViolation
from servoloop.campaign.tally import INVARIANTS, RunOutcome, RunRow, Tally
from servoloop.simulation.cycle_recorder import CycleRecording
from servoloop.simulation.schedule import schedule_text
from servoloop.simulation.trace_file import packet_texts
from sim_backend.faults.event import Event
from sim_backend.faults.text import text_of

if TYPE_CHECKING:  # servoloop.plots needs matplotlib, which may be missing
    from servoloop.plots import Panel, Stretch

MOST_ROWS: Final = 200
"""Maximum number of violations in the table on the page. ``--json`` prints all violations."""
COLORS: Final = ("#b00020", "#7a7a7a", "#e69f00", "#0072b2")
"""Colors of the run outcomes, in the order of ``RunOutcome``."""
MOST_BARS: Final = 40
"""Maximum number of bars in the histogram of fault times."""


@dataclass(frozen=True, slots=True)
class Moment:
    """One cycle of a trace, as shown in the tables on the page."""

    time_s: float
    injected: str
    faults: str
    hardware: str
    controllers: str
    command: tuple[float, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    packets: list[str]
    violated: bool
    """Whether this is the first cycle after the violation."""


def write(path: Path, tally: Tally | None, kept: Sequence[KeptViolation]) -> None:
    """Write the report to the file ``path``. Raises DriverError if the file cannot be written."""
    write_file(path, page(tally, kept), keep=False)


def page(tally: Tally | None, kept: Sequence[KeptViolation]) -> str:
    """Return the report as HTML. Without a tally, the report contains only the saved violations.

    Raises:
        ImportError: A library of the ``report`` extra is not installed.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("servoloop.campaign", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        tally=tally,
        plots=_plots(tally) if tally else [],
        most_rows=MOST_ROWS,
        before_s=BEFORE_S,
        kept=[_section(one) for one in kept],
    )


def _plots(tally: Tally) -> list[tuple[str, str]]:
    """Return the heading and the SVG of each plot for a campaign."""
    from servoloop.plots import points

    following = _by_outcome(tally, lambda row: row.largest_following_rad)
    durations = _by_outcome(tally, lambda row: row.simulated_s)
    return [
        ("Runs that violate each invariant", _violations(tally)),
        ("Faults by kind and outcome of their run", _fault_kinds(tally)),
        ("Start times of the faults", _fault_times(tally)),
        ("Largest following error of each run", points(following, COLORS, "seed", "following error (rad)")),
        ("Simulated duration of each run", points(durations, COLORS, "seed", "duration (s)")),
    ]


def _violations(tally: Tally) -> str:
    from servoloop.plots import stacked_bars

    runs = Counter(violation.invariant for _, violation in tally.violations)
    series = {"runs that violate it": [runs[name] for name in INVARIANTS]}
    return stacked_bars(INVARIANTS, series, COLORS[:1], "runs")


def _fault_kinds(tally: Tally) -> str:
    from servoloop.plots import stacked_bars

    kinds = sorted({kind for kind, _ in tally.drawn})
    series = {outcome.value: [tally.drawn[kind, outcome] for kind in kinds] for outcome in RunOutcome}
    return stacked_bars(kinds, series, COLORS, "faults drawn")


def _fault_times(tally: Tally) -> str:
    from servoloop.plots import histogram

    last_s = max((second for second, _ in tally.begun), default=0)
    width_s = ceil((last_s + 1) / MOST_BARS)
    edges_s = [*range(0, last_s + 1 + width_s, width_s)]

    def counts(outcome: RunOutcome) -> list[int]:
        return [sum(tally.begun[second, outcome] for second in range(*gap)) for gap in pairwise(edges_s)]

    series = {outcome.value: counts(outcome) for outcome in RunOutcome}
    return histogram(edges_s, series, COLORS, "start of the fault, after the arm was up (s)", "faults")


def _by_outcome(tally: Tally, value: Callable[[RunRow], float | None]) -> dict[str, list[tuple[float, float]]]:
    found: dict[str, list[tuple[float, float]]] = {outcome.value: [] for outcome in RunOutcome}
    for row in tally.rows:
        number = value(row)
        if number is not None:
            found[row.outcome.value].append((row.seed, number))
    return found


def _section(kept: KeptViolation) -> dict[str, Any]:
    """Return the values that the template displays for one saved violation."""
    joints = files_of(kept.schedule.arm).robot.joints
    return {
        "violation": kept.violation,
        "schedule": schedule_text(kept.schedule),
        "command": kept.command,
        "recording": kept.recording,
        "note": kept.note,
        "trace_name": kept.trace_path.name if kept.trace_path else "",
        "plot": _trace(kept, joints) if kept.recording.cycles else "",
        "moments": _moments(kept, packet_texts(kept.recording, joints)),
    }


def _moments(kept: KeptViolation, packets: Sequence[list[str]]) -> list[Moment]:
    after = [cycle for cycle in kept.recording.cycles if cycle.time_s >= kept.violation.time_s]
    return [
        Moment(
            cycle.time_s,
            "; ".join(text_of(event) for event in cycle.injected),
            "; ".join(f"{joint}: {kind}" for joint, kind in cycle.faults.items()),
            cycle.hardware,
            "; ".join(f"{name}: {state}" for name, state in cycle.controllers.items()),
            cycle.command,
            cycle.position,
            cycle.velocity,
            lines,
            bool(after) and cycle is after[0],
        )
        for cycle, lines in zip(kept.recording.cycles, packets, strict=True)
    ]


def _trace(kept: KeptViolation, joints: Sequence[Joint]) -> str:
    """Plot the positions, commands, following errors and velocities of a saved violation."""
    from servoloop.plots import time_series

    recording = kept.recording
    times_s = [cycle.time_s for cycle in recording.cycles]
    metric = {joint.name for joint in joints if joint.unit == "m"}
    panels: list[Panel] = []
    for unit, names in (
        ("rad", [name for name in recording.joints if name not in metric]),
        ("m", [name for name in recording.joints if name in metric]),
    ):
        if names:
            panels += _panels(recording, names, unit)
    return time_series(times_s, panels, _stretches(recording), kept.violation.time_s)


def _panels(recording: CycleRecording, names: Sequence[str], unit: str) -> "list[Panel]":
    from servoloop.plots import Curve, Panel

    measured = {name: _values(recording, "position", name) for name in names}
    speeds = tuple(Curve(name, _values(recording, "velocity", name)) for name in names)
    wanted = {name: _commands(recording, name) for name in names if f"{name}/position" in recording.interfaces}
    errors = tuple(
        Curve(name, [want - was for want, was in zip(values, measured[name], strict=True)])
        for name, values in wanted.items()
    )
    curves = (Curve(name, values) for name, values in measured.items())
    dashed = (Curve(name, values, dashed=True) for name, values in wanted.items())
    return [
        Panel(f"position ({unit})\ndashed: command", (*curves, *dashed)),
        Panel(f"command − position ({unit})", errors),
        Panel(f"velocity ({unit}/s)", speeds),
    ]


def _values(recording: CycleRecording, quantity: str, joint: str) -> list[float]:
    place = recording.joints.index(joint)
    return [getattr(cycle, quantity)[place] for cycle in recording.cycles]


def _commands(recording: CycleRecording, joint: str) -> list[float]:
    place = recording.interfaces.index(f"{joint}/position")
    return [cycle.command[place] for cycle in recording.cycles]


def _stretches(recording: CycleRecording) -> "list[Stretch]":
    """Return the time span of each injected fault in the recording."""
    from servoloop.plots import Stretch

    seen: dict[Event, list[float]] = {}
    for cycle in recording.cycles:
        for event in cycle.injected:
            seen.setdefault(event, []).append(cycle.time_s)
    return [Stretch(text_of(event), times[0], times[-1]) for event, times in seen.items()]
