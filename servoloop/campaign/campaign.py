"""A campaign: one scenario with many seeds, on several processes, with the same result however many there are."""

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import cast

from pydantic import BaseModel, ConfigDict, Field

from drivers.errors import DriverError
from hal.yaml_file import load
from servoloop.arms.folder import OWN, find_arm, read_arm_files
from servoloop.arms.pick_place import load_pick_place
from servoloop.campaign.invariants import Violation
from servoloop.campaign.run import RunReport, run_schedule
from servoloop.files import Files
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.stack_faults import inventory_of
from sim_backend.faults.draw import draw
from sim_backend.faults.errors import FaultError
from sim_backend.faults.events import FaultEvent

CHUNK = 5
"""Runs that a process takes at once."""
TASKS_OF_A_PROCESS = 20
"""Chunks; a hundred runs leave some 200 MB behind."""


class ScenarioError(DriverError):
    """A scenario that cannot be read; all its mistakes, each with its line."""


class Scenario(BaseModel):
    """What all runs of a campaign have in common; the rest is drawn from each run's seed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    arm: str = OWN
    job: tuple[str, ...] = ()
    """Grades, one job each."""
    seconds: float = Field(0.0, ge=0.0)
    """So long the arm stays up behind its jobs."""
    backlash_deg: float = Field(1.0, ge=0.0, le=10.0)
    faults: int = Field(3, ge=0)
    """So many in each run."""
    within_s: float = Field(10.0, gt=0.0)
    """Since the arm is up: by then all have begun."""
    kinds: tuple[str, ...] | None = None
    """Of faults; None: all that the arm can have."""


def read_scenario(path: Path) -> Scenario:
    """The scenario in this YAML file. Raises ScenarioError."""
    return load(path, Scenario, ScenarioError)


def schedule_of(scenario: Scenario, seed: int) -> Schedule:
    """Everything that happens in the run of this seed, drawn before it begins. Raises FaultError for unknown kinds."""
    there = inventory_of(_files(scenario.arm).robot)
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


def run_seed(scenario: Scenario, seed: int) -> SeedReport:
    """One run: the schedule is drawn, and carried out."""
    schedule = schedule_of(scenario, seed)
    report = run_schedule_of(schedule)
    return SeedReport(seed, schedule, report.violations, report.succeeded, report.ended, report.simulated_s)


def run_schedule_of(schedule: Schedule) -> RunReport:
    """Run a schedule on the arm that it names. An exception that no program may end with is a violation too."""
    settings = load_pick_place(find_arm(schedule.arm).pick_place).settings()
    try:
        return run_schedule(_files(schedule.arm), settings, schedule)
    except FaultError:
        raise  # the schedule is wrong, not the stack
    except Exception as error:  # a bug, and the other seeds shall be looked at as well
        crash = Violation("no crash", 0.0, f"{type(error).__name__}: {error}")
        return RunReport(schedule, (crash,), 0, str(error), 0.0)


@cache
def _files(arm: str) -> Files:
    return read_arm_files(find_arm(arm))


def campaign(
    scenario: Scenario, seeds: range, processes: int, progress: Callable[[SeedReport], None] = lambda report: None
) -> list[SeedReport]:
    """Run all seeds; the reports are in the order of the seeds. ``progress`` is told of each as it comes."""
    schedule_of(scenario, seeds.start)  # a mistake in the scenario is told before anything is started
    reports: list[SeedReport] = []
    for report in _reports(scenario, seeds, processes):
        progress(report)
        reports.append(report)
    return reports


def _reports(scenario: Scenario, seeds: range, processes: int) -> Iterator[SeedReport]:
    run = partial(run_seed, scenario)
    if processes == 1:
        with _quiet():
            yield from map(run, seeds)
        return
    # A new process every so often gives back what its stacks have left behind.
    context = get_context("spawn")
    with ProcessPoolExecutor(processes, context, _silence, max_tasks_per_child=TASKS_OF_A_PROCESS) as pool:
        yield from pool.map(run, seeds, chunksize=CHUNK)


def _silence() -> None:
    """What thousands of arms log about their faults is nobody's concern."""
    logging.disable(logging.CRITICAL)


class _quiet:
    def __enter__(self) -> None:
        self._former = logging.root.manager.disable
        _silence()

    def __exit__(self, *_: object) -> None:
        logging.disable(self._former)
