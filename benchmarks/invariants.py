"""Measure the cost of the campaign invariants by running the same schedules with all invariants and without any."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.shared.stopwatch import Stopwatch
from servoloop.campaign.campaign import files_of, read_scenario, schedule_of
from servoloop.campaign.invariants import Invariant
from servoloop.campaign.invariants.watch import ALL
from servoloop.campaign.run import run_schedule
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.workers import quiet
from servoloop.simulation.job import job_settings
from servoloop.simulation.schedule import Schedule
from servoloop.stack.arm_folders import find_arm

SCENARIO: Final = Path(__file__).parents[1] / "docs" / "campaign.yaml"
"""The default scenario."""
SEEDS: Final = 10
REPEATS: Final = 3
"""Number of times each run is repeated. The shortest repetition is used."""
HOOKS: Final = ("__init__", *(name for name in vars(Invariant) if name.startswith("on_")), "at_end")
"""Methods of an invariant whose execution time is measured."""

Kinds = tuple[type[Invariant], ...]


@dataclass(frozen=True, slots=True)
class InvariantCost:
    """Processor time of all runs in seconds, and each invariant's fraction of the total time of all invariants."""

    runs: int
    with_all_s: float
    without_s: float
    ratio: float
    shares: dict[str, float]


def default_scenario() -> Scenario:
    """Read the default scenario. Raises ScenarioError."""
    return read_scenario(SCENARIO)


def cost(scenario: Scenario, seeds: int = SEEDS) -> InvariantCost:
    """Measure the runs of a scenario's first seeds.

    Each run is executed with all invariants and directly afterward without any, so that the conditions are the same.
    The fractions are measured in separate runs, because the stopwatch itself adds overhead.
    """
    schedules = [schedule_of(scenario, seed) for seed in range(seeds)]
    with quiet():
        cpu_s(schedules[0], ALL)  # reads files and compiles
        pairs = [_best_s(schedule) for schedule in schedules]
        shares = shares_of(schedules)
    with_all_s, without_s = map(sum, zip(*pairs, strict=True))
    return InvariantCost(seeds, with_all_s, without_s, with_all_s / without_s, shares)


def _best_s(schedule: Schedule) -> tuple[float, float]:
    """Return the shortest processor times of a run with all invariants and without any, in seconds."""
    pairs = [(cpu_s(schedule, ALL), cpu_s(schedule, ())) for _ in range(REPEATS)]
    with_all_s, without_s = map(min, zip(*pairs, strict=True))
    return with_all_s, without_s


def cpu_s(schedule: Schedule, kinds: Kinds) -> float:
    """Return the processor time of one run, in seconds."""
    settings, files = job_settings(find_arm(schedule.arm), schedule.job), files_of(schedule.arm)
    begin_s = time.process_time()
    run_schedule(files, settings, schedule, kinds)
    return time.process_time() - begin_s


def shares_of(schedules: Sequence[Schedule]) -> dict[str, float]:
    """Return each invariant's fraction of the total time of all invariants, keyed by invariant name."""
    stopwatch = Stopwatch()
    kinds = tuple(timed(kind, stopwatch) for kind in ALL)
    for schedule in schedules:
        cpu_s(schedule, kinds)
    return stopwatch.shares()


def timed(kind: type[Invariant], stopwatch: Stopwatch) -> type[Invariant]:
    """Return a copy of an invariant whose execution time is recorded by the stopwatch under the invariant's name."""
    own = [hook for hook in HOOKS if hook == "__init__" or getattr(kind, hook) is not getattr(Invariant, hook)]
    return type(kind.__name__, (kind,), {hook: stopwatch.timed(kind.name, getattr(kind, hook)) for hook in own})
