"""Schedules: everything that a simulated run depends on, in a file that the run can be replayed from."""

from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict

from drivers.errors import DriverError
from hal.plausible import Backlash, Seed, Time
from hal.robot_file.robot_file import ExitPolicy
from hal.yaml_file import load
from hal.yaml_nodes import compose
from servoloop.simulation.acts import Act
from servoloop.stack.arm_folders import OWN, arm_in
from sim_backend.faults.event import Event
from sim_backend.faults.events import FaultEvent
from sim_backend.faults.script import plain


class ScheduleError(DriverError):
    """A schedule that cannot be read; all its mistakes, each with its line."""


class Schedule(BaseModel):
    """One run: which arm, which jobs, and what goes wrong when. ``faults`` count from their moments, s."""

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
    clients: tuple[Act, ...] = ()
    """What clients do beside the jobs, since the arm is up."""
    on_exit: ExitPolicy | None = None
    """How the arm is left at the end; None: as the robot file leaves virtual servos."""


def read_schedule(path: Path) -> Schedule:
    """Read the schedule in this YAML file.

    Raises ScheduleError for its mistakes and for what begins after the run, ArmFileError for an unknown arm.
    """
    schedule = load(path, Schedule, ScheduleError)
    arm_in(path, schedule.arm)
    if late := behind_the_end(schedule):
        file = compose(path, ScheduleError)
        raise ScheduleError("\n".join(f"{file.place((*place, 'at_s'))}: {text}" for place, text in late))
    return schedule


def behind_the_end(schedule: Schedule) -> list[tuple[tuple[str, int], str]]:
    """The faults and acts that begin only when the run is over: the place and a sentence for each.

    The length of a run with jobs is not known.
    """
    if schedule.job:
        return []
    end_s, faults, acts = schedule.seconds, enumerate(schedule.faults), enumerate(schedule.clients)
    late = [(("faults", n), _late(one, end_s)) for n, one in faults if one.since == "up" and one.at_s > end_s]
    return late + [(("clients", n), _late(act, end_s)) for n, act in acts if act.at_s > end_s]


def _late(one: FaultEvent | Act, end_s: float) -> str:
    text = f"{one.kind} begins at {one.at_s:g} s, and the run ends after {end_s:g} s: let it begin earlier"
    if isinstance(one, Event):
        return f"{text}, make `seconds` longer, or write `since: end`"
    return f"{text}, or make `seconds` longer"


def schedule_text(schedule: Schedule) -> str:
    """What ``read_schedule`` reads; what is as by default is left out."""
    content = schedule.model_dump(exclude={"faults", "clients"}, exclude_defaults=True)
    content = {name: list(value) if isinstance(value, tuple) else value for name, value in content.items()}
    if schedule.faults:
        content["faults"] = [plain(event) for event in schedule.faults]
    if schedule.clients:
        content["clients"] = [act.model_dump() for act in schedule.clients]
    return yaml.safe_dump(content, sort_keys=False)
