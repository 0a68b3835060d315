"""The report of a campaign: one page without scripts that opens without a network, the same bytes for the same runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from servoloop.campaign.campaign import files_of
from servoloop.campaign.kept_violation import BEFORE_S, KeptViolation
from servoloop.campaign.tally import Tally
from servoloop.extras import install_command
from servoloop.simulation.schedule import schedule_text
from servoloop.simulation.trace_file import packet_texts
from servoloop.stack.robot_files import write_file
from sim_backend.faults.text import text_of

NEEDED: Final = ("matplotlib", "jinja2")
MISSING: Final = f"no page is written: it needs matplotlib and Jinja2: {install_command('report')}"
MOST_ROWS: Final = 200
"""Violations in the table of the page; all of them are in what --json prints."""


def possible() -> bool:
    """Whether what a page needs is installed."""
    return all(find_spec(name) is not None for name in NEEDED)


@dataclass(frozen=True, slots=True)
class Moment:
    """A cycle of a trace as the page's table has it."""

    time_s: float
    injected: str
    faults: str
    hardware: str
    controllers: str
    command: tuple[float, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    packets: list[str]
    fell: bool
    """Whether it is the first one behind the violation."""


def page(tally: Tally | None, fallen: Sequence[KeptViolation]) -> str:
    """The report in HTML; without ``tally`` only what fell. ``possible()`` must hold."""
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
        fallen=[_section(one) for one in fallen],
    )


def write(path: Path, tally: Tally | None, fallen: Sequence[KeptViolation]) -> None:
    """Write the report into the file ``path``. Raises DriverError."""
    write_file(path, page(tally, fallen), keep=False)


def _plots(tally: Tally) -> list[tuple[str, str]]:
    """Heading and plot."""
    from servoloop.campaign import figures

    return [
        ("Runs in which each invariant fell", figures.violations(tally)),
        ("Faults drawn, by what came of their run", figures.fault_kinds(tally)),
        ("When they began, in the same colours", figures.fault_times(tally)),
        ("Largest following error of each run, in the same colours", figures.following_errors(tally)),
        ("Simulated time of each run, in the same colours", figures.durations(tally)),
    ]


def _section(fallen: KeptViolation) -> dict[str, Any]:
    from servoloop.campaign import figures

    joints = files_of(fallen.schedule.arm).robot.joints
    return {
        "violation": fallen.violation,
        "schedule": schedule_text(fallen.schedule),
        "command": fallen.command,
        "recording": fallen.recording,
        "note": fallen.note,
        "trace_name": fallen.trace_path.name if fallen.trace_path else "",
        "plot": figures.trace(fallen, joints) if fallen.recording.cycles else "",
        "moments": _moments(fallen, packet_texts(fallen.recording, joints)),
    }


def _moments(fallen: KeptViolation, packets: Sequence[list[str]]) -> list[Moment]:
    behind = [cycle for cycle in fallen.recording.cycles if cycle.time_s >= fallen.violation.time_s]
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
            said,
            bool(behind) and cycle is behind[0],
        )
        for cycle, said in zip(fallen.recording.cycles, packets, strict=True)
    ]
