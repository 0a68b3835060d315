"""A campaign: one scenario with many seeds, on several processes, with the same result however many there are."""

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Annotated, Any, Final, Literal, TypeVar, cast

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, ValidationInfo, field_validator

from drivers.errors import DriverError
from hal.plausible import Backlash, Duration, FaultCount, Time
from hal.robot_file.robot_file import ExitPolicy
from hal.yaml_file import load
from hal.yaml_nodes import compose, listed
from servoloop.campaign.contradictions import Mistake, in_scenario, in_schedule, joints_and_hand
from servoloop.campaign.draw_clients import draw_client
from servoloop.campaign.hangs import ended_when_it_stands, limit
from servoloop.campaign.promises import Promises
from servoloop.campaign.ray_workers import on_ray
from servoloop.campaign.run import NO_CRASH, NO_HANG, NOT_KILLED, RunReport, lost_run, run_schedule
from servoloop.campaign.supervised import Loss, WorkerError
from servoloop.campaign.workers import Stop, in_processes, in_this_process
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import job_settings, require_cell
from servoloop.simulation.schedule import Schedule, ScheduleError
from servoloop.simulation.stack_faults import inventory_of, require_possible_in
from servoloop.stack.arm_folders import OWN, arm_in, find_arm, read_arm_files
from servoloop.stack.robot_files import Files
from sim_backend.clock import Hang
from sim_backend.faults.draw import draw
from sim_backend.faults.errors import FaultError
from sim_backend.faults.events import KINDS, FaultEvent

KILLED_IN_A_ROW: Final = 3
"""Number of seeds whose processes are killed one after the other, at which a campaign ends."""


class ScenarioError(DriverError):
    """A scenario that cannot be read; all its mistakes, each with its line."""


Item = TypeVar("Item")


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _not_empty(items: tuple[Item, ...]) -> tuple[Item, ...]:
    if not items:
        raise ValueError("the list is empty: name at least one, or leave out the key")
    return items


OneOrMore = Annotated[tuple[Item, ...], AfterValidator(_not_empty), BeforeValidator(_listed)]
ClientKind = Literal["job", "moves", "plans", "streams", "switches", "jogs", "guides"]


class Scenario(BaseModel):
    """What all runs of a campaign have in common; the rest is drawn from each run's seed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    arm: OneOrMore[str] = (OWN,)
    """The arms; each run draws one."""
    clients: OneOrMore[ClientKind] = ("job",)
    """Kinds of clients. ``job`` does the jobs, the others move the arm as long as it is up."""
    on_exit: OneOrMore[ExitPolicy] | None = None
    """How the arm is left at the end. None: as its robot file leaves virtual servos."""
    job: Annotated[tuple[str, ...], BeforeValidator(_listed)] = ()
    """Grades, one job each."""
    seconds: Time = 0.0
    """Time that the arm stays up after its jobs."""
    backlash_deg: Backlash = 1.0
    faults: FaultCount = 3
    """So many in each run."""
    within_s: Duration = 10.0
    """Since the arm is up: by then all have begun that happen while it is up; without jobs within ``seconds``."""
    kinds: OneOrMore[str] | None = None
    """Of faults; None: all that the arm can have."""
    promises: Promises = Promises()
    """What the campaign must have looked at; it fails if it did not."""

    @field_validator("job")
    @classmethod
    def _done_by_a_client(cls, job: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        if job and "job" not in info.data.get("clients", ("job",)):
            raise ValueError("no client does these jobs: add `job` to `clients`, or leave out the jobs")
        return job

    @field_validator("within_s")
    @classmethod
    def _within_the_run(cls, within_s: float, info: ValidationInfo) -> float:
        said = info.data
        alone = not said.get("job") and said.get("clients", ("job",)) == ("job",)
        if alone and said.get("faults") and within_s > said.get("seconds", within_s):
            raise ValueError(
                f"a fault after {said['seconds']:g} s would not happen, as the run without jobs ends then: write at "
                "most `seconds`, or make `seconds` longer"
            )
        return within_s

    @field_validator("kinds")
    @classmethod
    def _known_kinds(cls, kinds: tuple[str, ...] | None) -> tuple[str, ...] | None:
        if unknown := [kind for kind in kinds or () if kind not in KINDS]:
            raise ValueError(f"there is no fault {', '.join(unknown)}: known are {', '.join(KINDS)}")
        return kinds


def read_scenario(path: Path, arm: str | None = None) -> Scenario:
    """Read the scenario in this YAML file, or the same with another arm.

    Raises ScenarioError for its mistakes and for what can happen in none of its runs, ArmFileError for an unknown arm.
    """
    scenario = load(path, Scenario, ScenarioError)
    if arm is not None:
        find_arm(arm)
        scenario = scenario.model_copy(update={"arm": (arm,)})
    else:
        for n, name in enumerate(scenario.arm):
            arm_in(path, name, n)
    mistakes = in_scenario(scenario, {name: files_of(name) for name in scenario.arm})
    _refuse(path, mistakes, ScenarioError)
    return scenario


def require_possible_schedule(path: Path, schedule: Schedule) -> None:
    """Check that the arm can do what the schedule in this file asks for.

    Raises ScheduleError for jobs and acts, FaultError for faults.
    """
    files = files_of(schedule.arm)
    _refuse(path, in_schedule(schedule, files), ScheduleError)
    require_possible_in(path, schedule.faults, inventory_of(files))


def _refuse(path: Path, mistakes: Iterable[Mistake], error: type[DriverError]) -> None:
    """Raise an error with file and line of each mistake, if there is one."""
    if found := [*mistakes]:
        file = compose(path, error)
        raise error("\n".join(listed([f"{file.place(place)}: {text}" for place, text in found])))


def schedule_of(scenario: Scenario, seed: int) -> Schedule:
    """Everything that happens in the run of this seed, drawn before it begins. Raises FaultError for unknown kinds."""
    random = Random(f"{seed}/scenario")
    arm, client = random.choice(scenario.arm), random.choice(scenario.clients)
    on_exit = random.choice(scenario.on_exit) if scenario.on_exit else None
    files = files_of(arm)
    jobs = scenario.job if client == "job" else ()
    acts = draw_client(client, seed, *joints_and_hand(files), scenario.within_s)
    seconds = scenario.seconds + (scenario.within_s if acts else 0.0)
    within_s = scenario.within_s if jobs else min(scenario.within_s, seconds)
    faults = draw(seed, inventory_of(files), within_s, scenario.faults, scenario.kinds)
    return Schedule(
        arm=arm,
        seed=seed,
        backlash_deg=scenario.backlash_deg,
        job=jobs,
        seconds=seconds,
        faults=cast(tuple[FaultEvent, ...], faults),
        clients=acts,
        on_exit=on_exit,
    )


def run_seed(scenario: Scenario, seed: int) -> RunReport:
    """Draw the schedule of a seed and run it."""
    return run_schedule_of(schedule_of(scenario, seed))


def run_schedule_of(schedule: Schedule, prepare: Callable[[FaultyStack], None] = lambda stack: None) -> RunReport:
    """Run a schedule on the arm that it names.

    An exception that no program may end with is a violation too, and so is a run that does not end. ``prepare`` gets
    the stack before it comes up.
    """
    settings = job_settings(find_arm(schedule.arm), schedule.job)
    require_cell(files_of(schedule.arm), schedule.job)
    stacks: list[FaultyStack] = []

    def now_s() -> float:
        return stacks[-1].clock.now() if stacks else 0.0

    def prepared(stack: FaultyStack) -> None:
        stacks.append(stack)
        limit(stack.clock, schedule)
        prepare(stack)

    try:
        with ended_when_it_stands(now_s):
            return run_schedule(files_of(schedule.arm), settings, schedule, prepare=prepared)
    except FaultError:
        raise  # the schedule is wrong, not the stack
    except Hang as hang:
        return lost_run(schedule, NO_HANG, now_s(), str(hang))
    except (Exception, SystemExit) as error:  # a bug, and the other seeds shall be looked at as well
        return lost_run(schedule, NO_CRASH, now_s(), f"{type(error).__name__}: {error}")


@cache
def files_of(arm: str) -> Files:
    """The files of an arm by its name or folder, read once."""
    return read_arm_files(find_arm(arm))


def campaign(
    scenario: Scenario, seeds: range, processes: int, stop: Stop = lambda: False, ray: str | None = None
) -> Iterator[RunReport]:
    """Run all seeds; their reports come one by one, in the order of the seeds, until ``stop`` says so.

    A run that hangs or is killed is reported as a violation; without ``processes`` the runs take place in this process,
    and one that is killed ends it. ``ray``: the address of a Ray cluster, or ``local`` for one that is started on this
    machine. Raises FaultError for a mistake in the scenario before anything is started, and RayError and WorkerError
    while it runs.
    """
    schedule_of(scenario, seeds.start)
    run, lost = partial(run_seed, scenario), partial(_lost_seed, scenario)
    if ray is not None:
        return _unless_all_die(on_ray(run, lost, seeds, ray, max(processes, 1), stop))
    if processes == 0:
        return in_this_process(run, seeds, stop)
    return _unless_all_die(in_processes(run, lost, seeds, processes, stop))


def _lost_seed(scenario: Scenario, seed: int, loss: Loss) -> RunReport:
    """The report of a seed whose process did not come to its end."""
    return lost_run(schedule_of(scenario, seed), NO_HANG if loss.hung else NOT_KILLED, loss.time_s, loss.text)


def _unless_all_die(reports: Generator[RunReport, None, None]) -> Iterator[RunReport]:
    """Raise WorkerError behind the report of the last of several seeds in a row whose process is killed."""
    in_a_row = 0
    with closing(reports):
        for report in reports:
            yield report
            killed = [one.text for one in report.violations if one.invariant == NOT_KILLED]
            in_a_row = in_a_row + 1 if killed else 0
            if in_a_row == KILLED_IN_A_ROW:
                raise WorkerError(
                    f"the processes of {in_a_row} seeds in a row were killed, the last one that of seed {report.seed} "
                    f"({killed[0]}), perhaps for want of memory: take fewer processes, with --jobs"
                )
