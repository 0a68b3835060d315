"""A campaign: one scenario with many seeds, on several processes, with the same result however many there are."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import cast

from pydantic import BaseModel, ConfigDict, field_validator

from drivers.errors import DriverError
from hal.plausible import Backlash, Duration, FaultCount, Time
from hal.yaml_file import load
from servoloop.arms.folder import OWN, arm_in, find_arm, read_arm_files
from servoloop.campaign.invariants import Violation
from servoloop.campaign.ray_workers import on_ray
from servoloop.campaign.run import RunReport, run_schedule
from servoloop.campaign.workers import Stop, in_processes, in_this_process
from servoloop.files import Files
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import job_settings, require_cell
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.stack_faults import inventory_of
from sim_backend.faults.draw import draw
from sim_backend.faults.errors import FaultError
from sim_backend.faults.events import KINDS, FaultEvent


class ScenarioError(DriverError):
    """A scenario that cannot be read; all its mistakes, each with its line."""


class Scenario(BaseModel):
    """What all runs of a campaign have in common; the rest is drawn from each run's seed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    arm: str = OWN
    job: tuple[str, ...] = ()
    """Grades, one job each."""
    seconds: Time = 0.0
    """So long the arm stays up behind its jobs."""
    backlash_deg: Backlash = 1.0
    faults: FaultCount = 3
    """So many in each run."""
    within_s: Duration = 10.0
    """Since the arm is up: by then all have begun."""
    kinds: tuple[str, ...] | None = None
    """Of faults; None: all that the arm can have."""

    @field_validator("kinds")
    @classmethod
    def _known_kinds(cls, kinds: tuple[str, ...] | None) -> tuple[str, ...] | None:
        if unknown := [kind for kind in kinds or () if kind not in KINDS]:
            raise ValueError(f"there is no fault {', '.join(unknown)}: known are {', '.join(KINDS)}")
        return kinds


def read_scenario(path: Path, arm: str | None = None) -> Scenario:
    """The scenario in this YAML file, or the same with another arm.

    Raises ScenarioError, and ArmFileError where there is no such arm.
    """
    scenario = load(path, Scenario, ScenarioError)
    if arm is not None:
        find_arm(arm)
        return scenario.model_copy(update={"arm": arm})
    arm_in(path, scenario.arm)
    return scenario


def schedule_of(scenario: Scenario, seed: int) -> Schedule:
    """Everything that happens in the run of this seed, drawn before it begins. Raises FaultError for unknown kinds."""
    there = inventory_of(files_of(scenario.arm).robot)
    return Schedule(
        arm=scenario.arm,
        seed=seed,
        backlash_deg=scenario.backlash_deg,
        job=scenario.job,
        seconds=scenario.seconds,
        faults=cast(tuple[FaultEvent, ...], draw(seed, there, scenario.within_s, scenario.faults, scenario.kinds)),
    )


@dataclass(frozen=True, slots=True)
class SeedReport:
    """One run of a campaign."""

    seed: int
    schedule: Schedule
    violations: tuple[Violation, ...]
    succeeded: int
    """Jobs whose cube is in its bin."""
    ended: str
    """Why the program ended early; empty where it did not."""
    simulated_s: float
    largest_following_rad: float | None
    """The largest following error of any joint of the arm; None where the arm was never told to move."""


def run_seed(scenario: Scenario, seed: int) -> SeedReport:
    """One run: the schedule is drawn, and carried out."""
    schedule = schedule_of(scenario, seed)
    report = run_schedule_of(schedule)
    return SeedReport(
        seed,
        schedule,
        report.violations,
        report.succeeded,
        report.ended,
        report.simulated_s,
        report.largest_following_rad,
    )


def run_schedule_of(schedule: Schedule, prepare: Callable[[FaultyStack], None] = lambda stack: None) -> RunReport:
    """Run a schedule on the arm that it names. An exception that no program may end with is a violation too.

    ``prepare`` gets the stack before it comes up.
    """
    settings = job_settings(find_arm(schedule.arm), schedule.job)
    require_cell(files_of(schedule.arm), schedule.job)
    stacks: list[FaultyStack] = []

    def prepared(stack: FaultyStack) -> None:
        stacks.append(stack)
        prepare(stack)

    try:
        return run_schedule(files_of(schedule.arm), settings, schedule, prepare=prepared)
    except FaultError:
        raise  # the schedule is wrong, not the stack
    except Exception as error:  # a bug, and the other seeds shall be looked at as well
        now_s = stacks[-1].clock.now() if stacks else 0.0
        crash = Violation("no crash", round(now_s, 4), f"{type(error).__name__}: {error}")
        return RunReport(schedule, (crash,), 0, str(error), now_s, None)


@cache
def files_of(arm: str) -> Files:
    """The files of an arm by its name or folder, read once."""
    return read_arm_files(find_arm(arm))


def campaign(
    scenario: Scenario, seeds: range, processes: int, stop: Stop = lambda: False, ray: str | None = None
) -> Iterator[SeedReport]:
    """Run all seeds; their reports come one by one, in the order of the seeds, until ``stop`` says so.

    ``ray``: the address of a Ray cluster, or ``local`` for one that is started on this machine. Raises FaultError for a
    mistake in the scenario before anything is started, and RayError and WorkerError while it runs.
    """
    schedule_of(scenario, seeds.start)
    run = partial(run_seed, scenario)
    if ray is not None:
        return on_ray(run, seeds, ray, processes, stop)
    if processes == 1:
        return in_this_process(run, seeds, stop)
    return in_processes(run, seeds, processes, stop)
