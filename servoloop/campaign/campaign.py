"""Run a campaign: one scenario with many seeds. The number of processes does not change the results."""

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Final, cast

from drivers.driver_errors import DriverError
from hal.yaml_file import load
from hal.yaml_nodes import compose, listed
from servoloop.campaign.contradictions import Mistake, hand_of, in_scenario, in_schedule, joints_and_hand
from servoloop.campaign.draws.arm import draw_firmware, draw_jam, draw_limits, draw_setting
from servoloop.campaign.draws.clients import draw_client
from servoloop.campaign.draws.coincidences import Coincidence, DrawnRun, draw_coincidence
from servoloop.campaign.draws.end import draw_end, draw_hurry
from servoloop.campaign.ray_workers import on_ray
from servoloop.campaign.run import NO_CRASH, NO_HANG, NOT_KILLED, RunReport, lost_run, run_schedule, with_narrow_limits
from servoloop.campaign.scenario import Scenario, ScenarioError
from servoloop.campaign.supervised import Loss, WorkerError, ended_when_it_stands, limit
from servoloop.campaign.workers import Stop, in_processes, in_this_process
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import job_settings, require_cell
from servoloop.simulation.schedule import Schedule, ScheduleError
from servoloop.simulation.stack_faults import inventory_of, require_possible_in
from servoloop.stack.arm_folders import arm_in, find_arm, read_arm_files
from servoloop.stack.robot_files import Files
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import NOMINAL_BUILD
from sim_backend.clock import Hang
from sim_backend.faults.draw import draw
from sim_backend.faults.events import FaultEvent
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.mechanics import JAMMED
from sim_backend.faults.settings import WRONG_SETTING

KILLED_IN_A_ROW: Final = 3
"""Number of consecutive seeds with killed processes after which a campaign is stopped."""


def read_scenario(path: Path, arm: str | None = None) -> Scenario:
    """Read a scenario from a YAML file.

    Args:
        path: The file.
        arm: Name or folder of an arm that replaces the arms of the scenario.

    Raises:
        ScenarioError: The scenario has an error, or requires something that is impossible in all of its runs.
        ArmFileError: An arm does not exist.
    """
    scenario = load(path, Scenario, ScenarioError)
    if arm is not None:
        find_arm(arm)
        scenario = scenario.model_copy(update={"arm": (arm,), "seldom": ()})
    else:
        for n, name in enumerate(scenario.arms):
            arm_in(path, name, scenario.place_of(n))
    mistakes = in_scenario(scenario, {name: files_of(name) for name in scenario.arms})
    _refuse(path, mistakes, ScenarioError)
    return scenario


def require_possible_schedule(path: Path, schedule: Schedule) -> None:
    """Check that the arm of a schedule can perform everything in the schedule.

    Args:
        path: Path of the schedule file.
        schedule: The schedule.

    Raises:
        ScheduleError: A job or a client action is impossible.
        FaultError: A fault is impossible.
    """
    files = files_of(schedule.arm)
    _refuse(path, in_schedule(schedule, files), ScheduleError)
    require_possible_in(path, schedule.faults, inventory_of(files))


def _refuse(path: Path, mistakes: Iterable[Mistake], error: type[DriverError]) -> None:
    """Raise an exception with the file and line of each error, if there are any."""
    if found := [*mistakes]:
        file = compose(path, error)
        raise error("\n".join(listed([f"{file.place(place)}: {text}" for place, text in found])))


def schedule_of(scenario: Scenario, seed: int) -> Schedule:
    """Draw a random schedule from a seed. Raises FaultError if a fault type is unknown."""
    random = Random(f"{seed}/scenario")
    arm, client = random.choice(scenario.arm), random.choice(scenario.clients)
    arm, on_exit = scenario.arm_of(seed, arm), random.choice(scenario.on_exit) if scenario.on_exit else None
    jobs = scenario.job if client == "job" else ()
    limits = {} if jobs else _draw_limits(seed, arm)
    files = with_narrow_limits(files_of(arm), limits)
    until_s = scenario.within_s if client == "job" else draw_end(seed, scenario.within_s)
    acts = draw_client(client, seed, *joints_and_hand(files, seed), until_s)
    seconds = until_s + (scenario.seconds if until_s == scenario.within_s else 0.0) if acts else scenario.seconds
    run = DrawnRun(files.robot.joints, acts, None if jobs else seconds, scenario.within_s if jobs else until_s)
    faults, acts = _draw_faults(scenario, seed, files, client, run)
    return Schedule(
        arm=arm,
        seed=seed,
        backlash_deg=scenario.backlash_deg,
        job=jobs,
        seconds=seconds,
        faults=cast(tuple[FaultEvent, ...], faults),
        clients=acts,
        limits=limits,
        firmware=draw_firmware(seed, files.robot.joints),
        on_exit=on_exit,
        hurry_s=draw_hurry(seed) if on_exit == "relax" else None,
    )


def _draw_faults(scenario: Scenario, seed: int, files: Files, client: str, run: DrawnRun) -> Coincidence:
    """Draw the faults of a run. Return them with the client's actions, to which coinciding faults may add."""
    within_s = run.within_s if run.end_s is None else min(run.within_s, run.end_s)
    faults = draw(seed, inventory_of(files), within_s, scenario.faults, scenario.kinds)
    if faults and _has(scenario, WRONG_SETTING):
        wrong = draw_setting(seed, files.robot.joints)
        faults = (*wrong, *faults[len(wrong) :])
    together, acts = draw_coincidence(seed, replace(run, within_s=within_s))
    if len(together) <= len(faults) and all(_has(scenario, event.kind) for event in together):
        faults, run = (*faults[: len(faults) - len(together)], *together), replace(run, acts=acts)
    if faults and client == "grips" and _has(scenario, JAMMED):
        jam = draw_jam(seed, [joint for joint in files.robot.joints if joint.name == hand_of(files)], within_s)
        faults = (*faults[: len(faults) - len(jam)], *jam)
    return faults, run.acts


def _has(scenario: Scenario, kind: str) -> bool:
    return scenario.kinds is None or kind in scenario.kinds


def run_seed(scenario: Scenario, seed: int) -> RunReport:
    """Draw a random schedule from a seed, and run it."""
    return run_schedule_of(schedule_of(scenario, seed))


def run_schedule_of(schedule: Schedule, prepare: Callable[[FaultyStack], None] = lambda stack: None) -> RunReport:
    """Run a schedule on its arm.

    Unexpected exceptions and runs that do not end are reported as violations.

    Args:
        schedule: The schedule.
        prepare: Function called with the stack before the stack starts.

    Raises:
        FaultError: A fault of the schedule is impossible on this arm.
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
        raise  # The schedule is at fault, not the stack.
    except Hang as hang:
        return lost_run(schedule, NO_HANG, now_s(), str(hang))
    except (Exception, SystemExit) as error:  # A bug in the stack must not stop the other seeds.
        return lost_run(schedule, NO_CRASH, now_s(), f"{type(error).__name__}: {error}")


@cache
def files_of(arm: str) -> Files:
    """Return the files of an arm, by its name or folder. The files are read only once."""
    return read_arm_files(find_arm(arm))


def _draw_limits(seed: int, arm: str) -> dict[str, tuple[float, float]]:
    files = files_of(arm)
    park = files.robot.file.park
    return draw_limits(seed, joints_and_hand(files, seed)[0], _positions_at_the_start(arm), park.pose if park else {})


@cache
def _positions_at_the_start(arm: str) -> dict[str, float]:
    """Return the positions of an arm's joints at the start of a run, in rad or m, keyed by joint name."""
    world = VirtualLines(files_of(arm), NOMINAL_BUILD).world
    return dict(zip(world.joints, world.position().tolist(), strict=True))


def campaign(
    scenario: Scenario, seeds: range, processes: int, stop: Stop = lambda: False, ray: str | None = None
) -> Iterator[RunReport]:
    """Run all seeds and yield their reports in seed order.

    A run that hangs or is killed is reported as a violation.

    Args:
        scenario: The scenario.
        seeds: The seeds.
        processes: Number of processes. If 0, the runs take place in this process, and killing a run ends this process.
        stop: Function that returns whether to stop before the next report.
        ray: Address of a Ray cluster, or ``local`` to start one on this machine. If None, Ray is not used.

    Raises:
        FaultError: The scenario has an error. The error is raised before the first run.
        ExtraError: Ray is not installed.
        RayError: The cluster does not respond.
        WorkerError: Processes are killed repeatedly, or cannot be started.
    """
    schedule_of(scenario, seeds.start)
    run, lost = partial(run_seed, scenario), partial(_lost_seed, scenario)
    if ray is not None:
        return _until_killed_in_a_row(on_ray(run, lost, seeds, ray, max(processes, 1), stop))
    if processes == 0:
        return in_this_process(run, seeds, stop)
    return _until_killed_in_a_row(in_processes(run, lost, seeds, processes, stop))


def _lost_seed(scenario: Scenario, seed: int, loss: Loss) -> RunReport:
    """Return the report of a seed whose run hung or was killed."""
    return lost_run(schedule_of(scenario, seed), NO_HANG if loss.hung else NOT_KILLED, loss.time_s, loss.text)


def _until_killed_in_a_row(reports: Generator[RunReport, None, None]) -> Iterator[RunReport]:
    """Yield the reports. Raises WorkerError after ``KILLED_IN_A_ROW`` consecutive seeds whose processes were killed."""
    in_a_row = 0
    with closing(reports):
        for report in reports:
            yield report
            killed = [one.text for one in report.violations if one.invariant == NOT_KILLED]
            in_a_row = in_a_row + 1 if killed else 0
            if in_a_row == KILLED_IN_A_ROW:
                raise WorkerError(
                    f"the processes of {in_a_row} consecutive seeds were killed, most recently the process of seed "
                    f"{report.seed} ({killed[0]}). If memory ran out, use fewer processes: set --jobs"
                )
