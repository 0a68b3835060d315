"""An invariant that fell: the smallest schedule that breaks it, and the last two seconds before as a trace."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from servoloop.campaign.campaign import files_of, run_schedule_of
from servoloop.campaign.invariants.watch import Violation
from servoloop.campaign.quiet import quiet
from servoloop.campaign.run import NO_HANG, NOT_KILLED, RunReport
from servoloop.campaign.shrinking import Violated, smallest, violated
from servoloop.campaign.workers import Stop
from servoloop.simulation.cycle_recorder import CycleRecorder, Recording
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule, schedule_text
from servoloop.simulation.trace_file import trace_text
from servoloop.stack.robot_files import write_file

BEFORE_S: Final = 2.0
CYCLES_BEHIND: Final = 4
NOTHING: Final = Recording((), (), ())
"""The recording of a run that was not recorded."""
AS_DRAWN: Final = {
    NO_HANG: "It is not minimized: every further run of it would last until the limit.",
    NOT_KILLED: "It is not minimized: every further run of it would end its process.",
}
"""Violations whose schedules are kept as they were drawn, and why."""
UNSEEN: Final = "It is not minimized: a second run of the schedule did not show it again."


@dataclass(frozen=True, slots=True)
class KeptViolation:
    """A violation as it is seen again, ``violation.time_s`` of the stack's clock, and where that is kept."""

    violation: Violation
    schedule: Schedule
    recording: Recording
    """``BEFORE_S`` before the violation and ``CYCLES_BEHIND`` behind it."""
    schedule_path: Path
    trace_path: Path | None
    """None: the schedule was not run again."""
    note: str = ""
    """Why the schedule is not the smallest one; empty if it is."""

    @property
    def command(self) -> str:
        """What shows it again, for a shell."""
        return shlex.join(["servoloop", "campaign", "--schedule", str(self.schedule_path)])


def recorded(schedule: Schedule) -> tuple[RunReport, Recording]:
    """Run a schedule and record all of it. Raises FaultError where a fault cannot happen to its arm."""
    recorders: list[CycleRecorder] = []

    def prepare(stack: FaultyStack) -> None:
        recorders.append(CycleRecorder(stack))

    with quiet():
        report = run_schedule_of(schedule, prepare)
    return report, recorders[-1].recording if recorders else NOTHING


def violates(schedule: Schedule, invariant: str) -> bool:
    """Whether a run of the schedule violates the invariant; one whose arm cannot have its faults does not."""
    return invariant in violated(schedule)


def keep(report: RunReport, invariant: str, out: Path, stop: Stop, violated: Violated = violated) -> KeptViolation:
    """Shrink the run's schedule, run it again, and write schedule and trace into ``out``. Raises DriverError.

    A run that hangs or is killed is not run again: its schedule is kept as it was drawn. ``violated`` runs schedules.
    """
    path = out / f"{stem_of(invariant)}-seed-{report.seed}.yaml"
    if invariant in AS_DRAWN:
        return _kept_as_drawn(report, invariant, path, AS_DRAWN[invariant])
    schedule = smallest(report.schedule, invariant, violated, stop)
    again, recording = recorded(schedule)
    violation = _of(again, invariant)
    if violation is None:
        return _kept_as_drawn(report, invariant, path, UNSEEN)
    _write(path, violation, schedule)
    return traced(violation, schedule, recording, path, path.with_suffix(".csv"))


def _kept_as_drawn(report: RunReport, invariant: str, path: Path, note: str) -> KeptViolation:
    violation = _of(report, invariant)
    assert violation is not None
    _write(path, violation, report.schedule, note)
    return KeptViolation(violation, report.schedule, NOTHING, path, None, note)


def _of(report: RunReport, invariant: str) -> Violation | None:
    return next((one for one in report.violations if one.invariant == invariant), None)


def _write(path: Path, violation: Violation, schedule: Schedule, note: str = "") -> None:
    text = " ".join(f"{violation.invariant}: {violation.text}".split())
    remarks = "".join(f"# {line}\n" for line in (text, note) if line)
    write_file(path, f"{remarks}{schedule_text(schedule)}", keep=False)


def traced(violation: Violation, schedule: Schedule, recording: Recording, path: Path, trace: Path) -> KeptViolation:
    """Write the trace of a violation of the schedule in the file ``path``; ``recording``: of the whole run."""
    part = recording.around(violation.time_s, BEFORE_S, CYCLES_BEHIND)
    write_file(trace, trace_text(part, files_of(schedule.arm).robot.joints), keep=False)
    return KeptViolation(violation, schedule, part, path, trace)


def stem_of(invariant: str) -> str:
    """The invariant in a file's name."""
    return invariant.replace(" ", "-").replace(",", "")
