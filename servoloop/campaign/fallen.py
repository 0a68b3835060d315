"""An invariant that fell: the smallest schedule that breaks it, and the last two seconds before as a trace."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from servoloop.campaign.campaign import files_of, run_schedule_of
from servoloop.campaign.invariants import Violation
from servoloop.campaign.run import RunReport
from servoloop.campaign.shrink import shrink
from servoloop.campaign.workers import Stop, quiet
from servoloop.simulation.cycle_recorder import CycleRecorder, Recording
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule, schedule_text
from servoloop.simulation.trace_file import trace_text
from servoloop.stack.robot_files import write_file
from sim_backend.faults.errors import FaultError

BEFORE_S: Final = 2.0
CYCLES_BEHIND: Final = 4


@dataclass(frozen=True, slots=True)
class Fallen:
    """A violation as it is seen again, ``violation.time_s`` of the stack's clock, and where that is kept."""

    violation: Violation
    schedule: Schedule
    recording: Recording
    """``BEFORE_S`` before the violation and ``CYCLES_BEHIND`` behind it."""
    schedule_path: Path
    trace_path: Path

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
    return report, recorders[-1].recording if recorders else Recording((), (), ())


def smallest(report: RunReport, invariant: str, stop: Stop) -> Schedule:
    """The smallest schedule found that breaks the invariant as this run did; ``stop``: no smaller one is looked for."""

    with quiet():
        return shrink(report.schedule, lambda schedule: violates(schedule, invariant), stop)


def violates(schedule: Schedule, invariant: str) -> bool:
    """Whether a run of the schedule violates the invariant; one whose arm cannot have its faults does not."""
    try:
        return any(violation.invariant == invariant for violation in run_schedule_of(schedule).violations)
    except FaultError:
        return False


def keep(report: RunReport, invariant: str, out: Path, stop: Stop) -> Fallen:
    """Shrink the run's schedule, run it again, and write schedule and trace into ``out``. Raises DriverError."""
    schedule = smallest(report, invariant, stop)
    again, recording = recorded(schedule)
    violation = next(one for one in again.violations if one.invariant == invariant)
    path = out / f"{stem_of(invariant)}-seed-{report.seed}.yaml"
    write_file(path, f"# {invariant}: {violation.text}\n{schedule_text(schedule)}", keep=False)
    return traced(violation, schedule, recording, path, path.with_suffix(".csv"))


def traced(violation: Violation, schedule: Schedule, recording: Recording, path: Path, trace: Path) -> Fallen:
    """Write the trace of a violation of the schedule in the file ``path``; ``recording``: of the whole run."""
    part = recording.around(violation.time_s, BEFORE_S, CYCLES_BEHIND)
    write_file(trace, trace_text(part, files_of(schedule.arm).robot.joints), keep=False)
    return Fallen(violation, schedule, part, path, trace)


def stem_of(invariant: str) -> str:
    """The invariant in a file's name."""
    return invariant.replace(" ", "-").replace(",", "")
