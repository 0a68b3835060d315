"""The plots of a campaign's report."""

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import ceil
from typing import Final

from hal.joint import Joint
from servoloop.campaign.kept_violation import KeptViolation
from servoloop.campaign.tally import INVARIANTS, Outcome, Row, Tally
from servoloop.plots import Curve, Panel, Stretch, histogram, points, stacked_bars, time_series
from servoloop.simulation.cycle_recorder import Recording
from sim_backend.faults.event import Event
from sim_backend.faults.text import text_of

COLOURS: Final = ("#b00020", "#7a7a7a", "#e69f00", "#0072b2")
"""Of the outcomes, in their order."""
MOST_BARS: Final = 40
"""Of the times at which faults began."""


def fault_kinds(tally: Tally) -> str:
    """Which faults were drawn, and what came of their runs."""
    kinds = sorted({kind for kind, _ in tally.drawn})
    series = {outcome.value: [tally.drawn[kind, outcome] for kind in kinds] for outcome in Outcome}
    return stacked_bars(kinds, series, COLOURS, "faults drawn")


def fault_times(tally: Tally) -> str:
    """When the faults began."""
    last_s = max((second for second, _ in tally.begun), default=0)
    width_s = ceil((last_s + 1) / MOST_BARS)
    edges_s = [*range(0, last_s + 1 + width_s, width_s)]

    def counts(outcome: Outcome) -> list[int]:
        return [sum(tally.begun[second, outcome] for second in range(*gap)) for gap in pairwise(edges_s)]

    series = {outcome.value: counts(outcome) for outcome in Outcome}
    return histogram(edges_s, series, COLOURS, "began so long after the arm was up (s)", "faults")


def following_errors(tally: Tally) -> str:
    """The largest following error of each run."""
    return points(_by_outcome(tally, lambda row: row.largest_following_rad), COLOURS, "seed", "following error (rad)")


def durations(tally: Tally) -> str:
    """How long each run lasted, on simulated time."""
    return points(_by_outcome(tally, lambda row: row.simulated_s), COLOURS, "seed", "duration (s)")


def violations(tally: Tally) -> str:
    """How often each invariant fell."""
    fell = Counter(one.invariant for _, one in tally.violations)
    return stacked_bars(INVARIANTS, {"runs in which it fell": [fell[name] for name in INVARIANTS]}, COLOURS[:1], "runs")


def trace(fallen: KeptViolation, joints: Sequence[Joint]) -> str:
    """Positions and commands, their difference, and velocities, until just behind the violation."""
    recording = fallen.recording
    times_s = [cycle.time_s for cycle in recording.cycles]
    metric = {joint.name for joint in joints if joint.transmission != 1.0}
    panels: list[Panel] = []
    for unit, names in (
        ("rad", [name for name in recording.joints if name not in metric]),
        ("m", [name for name in recording.joints if name in metric]),
    ):
        if names:
            panels += _panels(recording, names, unit)
    return time_series(times_s, panels, _stretches(recording), fallen.violation.time_s)


def _panels(recording: Recording, names: Sequence[str], unit: str) -> list[Panel]:
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


def _values(recording: Recording, what: str, joint: str) -> list[float]:
    place = recording.joints.index(joint)
    return [getattr(cycle, what)[place] for cycle in recording.cycles]


def _commands(recording: Recording, joint: str) -> list[float]:
    place = recording.interfaces.index(f"{joint}/position")
    return [cycle.command[place] for cycle in recording.cycles]


def _stretches(recording: Recording) -> list[Stretch]:
    """For how long each injected fault is seen in the recording."""
    seen: dict[Event, list[float]] = {}
    for cycle in recording.cycles:
        for event in cycle.injected:
            seen.setdefault(event, []).append(cycle.time_s)
    return [Stretch(text_of(event), times[0], times[-1]) for event, times in seen.items()]


def _by_outcome(tally: Tally, value: Callable[[Row], float | None]) -> dict[str, list[tuple[float, float]]]:
    found: dict[str, list[tuple[float, float]]] = {outcome.value: [] for outcome in Outcome}
    for row in tally.rows:
        number = value(row)
        if number is not None:
            found[row.outcome.value].append((row.seed, number))
    return found
