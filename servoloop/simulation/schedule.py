"""Schedules: everything that a simulated run depends on, in a file that the run can be replayed from."""

from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict

from drivers.errors import DriverError
from hal.plausible import Backlash, Seed, Time
from hal.yaml_file import load
from servoloop.arms.folder import OWN, arm_in
from sim_backend.faults.events import FaultEvent
from sim_backend.faults.script import plain


class ScheduleError(DriverError):
    """A schedule that cannot be read; all its mistakes, each with its line."""


class Schedule(BaseModel):
    """One run: which arm, which jobs, and what goes wrong when. ``faults`` count from when the arm is up, s."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    arm: str = OWN
    seed: Seed | None = None
    """Of the arm's friction, motors, masses and supply; None: the nominal ones."""
    backlash_deg: Backlash = 1.0
    job: tuple[str, ...] = ()
    """Grades, one job each."""
    seconds: Time = 0.0
    """So long the arm stays up behind its jobs."""
    faults: tuple[FaultEvent, ...] = ()


def read_schedule(path: Path) -> Schedule:
    """The schedule in this YAML file. Raises ScheduleError, and ArmFileError where there is no such arm."""
    schedule = load(path, Schedule, ScheduleError)
    arm_in(path, schedule.arm)
    return schedule


def schedule_text(schedule: Schedule) -> str:
    """What ``read_schedule`` reads; what is as by default is left out."""
    content = schedule.model_dump(exclude={"faults"}, exclude_defaults=True)
    content = {name: list(value) if isinstance(value, tuple) else value for name, value in content.items()}
    faults = {"faults": [plain(event) for event in schedule.faults]} if schedule.faults else {}
    return yaml.safe_dump({**content, **faults}, sort_keys=False)
