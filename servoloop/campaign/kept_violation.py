"""Save a violation: write the smallest schedule that reproduces it, and a trace of the two seconds before it."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from commissioning.atomic_write import write_file
from servoloop.campaign.campaign import files_of, run_schedule_of
from servoloop.campaign.invariants import Violation
from servoloop.campaign.run import NO_HANG, NOT_KILLED, RunReport
from servoloop.campaign.shrink import Violated, smallest, violated
from servoloop.campaign.workers import Stop, quiet
from servoloop.simulation.cycle_recorder import CycleRecorder, CycleRecording
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule, schedule_text
from servoloop.simulation.trace_file import trace_text

BEFORE_S: Final = 2.0
"""Duration of a trace before the violation, in seconds."""
CYCLES_BEHIND: Final = 4
"""Duration of a trace after the violation, in cycles."""
NOTHING: Final = CycleRecording((), (), (), {})
"""Empty recording, for a run that was not recorded."""
AS_DRAWN: Final = {
    NO_HANG: "The schedule is not minimized: every further run would last until its time limit.",
    NOT_KILLED: "The schedule is not minimized: every further run would end its process.",
}
"""Invariants whose schedules are saved as they were drawn, with the reason."""
UNSEEN: Final = "The schedule is not minimized: the violation did not recur in a second run."


@dataclass(frozen=True, slots=True)
class KeptViolation:
    """A violation, the schedule that reproduces it, and the files that contain the schedule and the trace."""

    violation: Violation
    schedule: Schedule
    recording: CycleRecording
    """Recording from ``BEFORE_S`` before the violation to ``CYCLES_BEHIND`` after it."""
    schedule_path: Path
    trace_path: Path | None
    """Path of the trace, or None if the schedule was not run again."""
    note: str = ""
    """Reason why the schedule is not minimized, or an empty string if it is minimized."""

    @property
    def command(self) -> str:
        """The shell command that reproduces the violation."""
        return shlex.join(["servoloop", "campaign", "--schedule", str(self.schedule_path)])


def recorded(schedule: Schedule) -> tuple[RunReport, CycleRecording]:
    """Run a schedule and record the whole run. Raises FaultError if a fault is impossible on the arm."""
    recorders: list[CycleRecorder] = []

    def prepare(stack: FaultyStack) -> None:
        recorders.append(CycleRecorder(stack))

    with quiet():
        report = run_schedule_of(schedule, prepare)
    return report, recorders[-1].recording if recorders else NOTHING


def violates(schedule: Schedule, invariant: str) -> bool:
    """Run a schedule and return whether it violates the invariant. An impossible schedule does not violate any
    invariant."""
    return invariant in violated(schedule)


def keep(report: RunReport, invariant: str, out: Path, stop: Stop, violated: Violated = violated) -> KeptViolation:
    """Minimize the schedule of a run, run it again, and write the schedule and its trace.

    A run that hangs or is killed is not repeated. Its schedule is saved as it was drawn.

    Args:
        report: Report of a run that violates the invariant.
        invariant: Name of the invariant.
        out: Folder for the files.
        stop: Function that returns whether to stop minimizing.
        violated: Function that runs a schedule and returns the invariants that it violates.

    Raises:
        DriverError: A file cannot be written, or a process cannot be started.
    """
    path = out / f"{stem_of(invariant)}-seed-{report.seed}.yaml"
    if invariant in AS_DRAWN:
        return _kept_as_drawn(report, invariant, path, AS_DRAWN[invariant])
    schedule = smallest(report.schedule, invariant, violated, stop)
    again, recording = recorded(schedule)
    violation = _violation_of(again, invariant)
    if violation is None:
        return _kept_as_drawn(report, invariant, path, UNSEEN)
    _write(path, violation, schedule)
    return traced(violation, schedule, recording, path, path.with_suffix(".csv"))


def _kept_as_drawn(report: RunReport, invariant: str, path: Path, note: str) -> KeptViolation:
    violation = _violation_of(report, invariant)
    assert violation is not None
    _write(path, violation, report.schedule, note)
    return KeptViolation(violation, report.schedule, NOTHING, path, None, note)


def _violation_of(report: RunReport, invariant: str) -> Violation | None:
    return next((one for one in report.violations if one.invariant == invariant), None)


def _write(path: Path, violation: Violation, schedule: Schedule, note: str = "") -> None:
    text = " ".join(f"{violation.invariant}: {violation.text}".split())
    remarks = "".join(f"# {line}\n" for line in (text, note) if line)
    write_file(path, f"{remarks}{schedule_text(schedule)}", keep=False)


def traced(
    violation: Violation, schedule: Schedule, recording: CycleRecording, path: Path, trace: Path
) -> KeptViolation:
    """Extract the trace of a violation from the recording of the whole run and write it to a file.

    Args:
        violation: The violation.
        schedule: The schedule of the run.
        recording: Recording of the whole run.
        path: File of the schedule.
        trace: Path to write the trace to.
    """
    part = recording.around(violation.time_s, BEFORE_S, CYCLES_BEHIND)
    write_file(trace, trace_text(part, files_of(schedule.arm).robot.joints), keep=False)
    return KeptViolation(violation, schedule, part, path, trace)


def stem_of(invariant: str) -> str:
    """Return the name of an invariant in the form that is used in file names."""
    return invariant.replace(" ", "-").replace(",", "")
