"""Run one schedule of a campaign from start to end while checking the invariants."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import chain
from typing import Final

from drivers.driver_errors import DriverError
from drivers.servos import x
from hal.hal_errors import HalError
from hal.robot_file.robot_file import ExitPolicy
from pick_place.settings import JobSettings
from servoloop.api.freedrive import Freedrive
from servoloop.campaign.invariants import Invariant, Violation
from servoloop.campaign.invariants.watch import ALL, Watch
from servoloop.campaign.socket_clients.connected_programs import ConnectedPrograms
from servoloop.campaign.visits import Visit
from servoloop.simulation.acts import SocketAct
from servoloop.simulation.clients import SimulatedClients
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import JobRecord
from servoloop.simulation.jobs import run_jobs
from servoloop.simulation.logged_defects import LoggedDefects
from servoloop.simulation.schedule import Schedule
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.pick_place import arm_jobs
from servoloop.stack.robot_files import Files
from sim_backend.buses.build import Build

NO_CRASH: Final = "no crash"
"""Invariant that is violated by an unexpected exception."""
NO_HANG: Final = "no hang"
"""Invariant that is violated by a run that does not end."""
NOT_KILLED: Final = "not killed"
"""Invariant that is violated by a run that terminates its process."""
WHOLE_RUN: Final = (NO_CRASH, NO_HANG, NOT_KILLED)
"""Invariants that apply to a run as a whole. They have no condition to check, so their checks are not counted."""


@dataclass(frozen=True, slots=True)
class RunReport:
    """Result of one run."""

    schedule: Schedule
    violations: tuple[Violation, ...]
    succeeded: int
    """Number of jobs that placed their cube in its bin."""
    ended: str
    """Reason why the program ended early, or an empty string if it ended normally."""
    simulated_s: float
    largest_following_rad: float | None
    """Largest following error of any joint of all arms, or None if the arm was never commanded to move."""
    examined: Mapping[str, int] = field(default_factory=dict)
    """Number of times that each invariant examined its condition, keyed by invariant name."""
    visits: Counter[Visit] = field(default_factory=Counter)
    """Number of cycles in which each fault was active, by phase, make and client."""

    @property
    def seed(self) -> int:
        """The seed of the schedule, or 0 if it has no seed."""
        return self.schedule.seed or 0

    @property
    def jobs(self) -> int:
        """Number of jobs for all arms."""
        return len(self.schedule.job) * arms_at_work(self.schedule.arm) if self.schedule.job else 0


@cache
def arms_at_work(arm: str) -> int:
    """Return the number of a robot's arms that run jobs. Raises ArmFileError."""
    return len(arm_jobs(find_arm(arm).pick_place))


def run_schedule(
    files: Files,
    settings: Mapping[str, JobSettings],
    schedule: Schedule,
    kinds: tuple[type[Invariant], ...] = ALL,
    prepare: Callable[[FaultyStack], None] = lambda stack: None,
) -> RunReport:
    """Run a schedule, then end the program.

    Args:
        files: Files of the arm.
        settings: Settings of each arm's pick-and-place node, keyed by arm name.
        schedule: Faults, jobs and clients of the run.
        kinds: Invariants to check during the run.
        prepare: Function called with the stack before the stack starts. Tests use it to inject a bug.

    Raises:
        FaultError: A fault of the schedule is impossible on this arm.
    """
    files = with_firmware(with_exit_policy(files, schedule.on_exit), schedule.firmware)
    files = with_narrow_limits(files, schedule.limits)
    stack = FaultyStack(files=files, build=Build(schedule.backlash_deg, schedule.seed), keep_alive=True)
    stack.narrowed = schedule.limits
    stack.player.plan(schedule.faults)
    prepare(stack)
    watch, jobs = Watch(stack, kinds), list[JobRecord]()
    with LoggedDefects() as defects:
        ended, programs = _run(stack, settings, schedule, jobs)
        end_program(stack, schedule.hurry_s)
    watch.end()
    stack.require_no_defect()
    if programs is not None:
        programs.require_no_defect()
    crashes = [Violation(NO_CRASH, round(stack.clock.now(), 4), defects.text)] if defects.text else []
    largest_rad = max(chain(*(stack.trace_of(arm.joints).following().largest_rad for arm in stack.arms)), default=None)
    violations, succeeded = (*watch.violations.values(), *crashes), sum(job.success for job in jobs)
    return RunReport(
        *(schedule, violations, succeeded, ended, stack.clock.now(), largest_rad), watch.examined, watch.visits.cycles
    )


def _run(
    stack: FaultyStack, settings: Mapping[str, JobSettings], schedule: Schedule, jobs: list[JobRecord]
) -> tuple[str, ConnectedPrograms | None]:
    """Run the jobs and the clients of a schedule, and append the jobs. Return the reason for an early end, and the
    programs on the command socket."""
    ended, programs = "", None
    try:
        stack.up()
        programs = ConnectedPrograms(stack) if any(isinstance(act, SocketAct) for act in schedule.clients) else None
        freedrive = Freedrive(stack.control_stack, stack.arm.joints, lambda action: action())
        stack.clients = SimulatedClients(stack, stack.arm, schedule.clients, freedrive, programs)
        run_jobs(stack, settings, schedule.job, jobs.append)
        stack.run(schedule.seconds)
    except (DriverError, HalError) as error:  # These errors are a normal way for the program to end.
        ended = str(error)
    stack.clients = None
    return ended, programs


def lost_run(schedule: Schedule, name: str, time_s: float, text: str) -> RunReport:
    """Return the report of a run that did not finish. The report contains only this violation and its time."""
    time_s = round(time_s, 4)
    return RunReport(schedule, (Violation(name, time_s, text),), 0, "", time_s, None)


def with_exit_policy(files: Files, on_exit: ExitPolicy | None) -> Files:
    """Return the files with this ``on_exit`` policy for virtual servos; None keeps the policy of the robot file."""
    if on_exit is None:
        return files
    policies = files.robot.file.on_exit.model_copy(update={"virtual": on_exit})
    robot_file = files.robot.file.model_copy(update={"on_exit": policies})
    return replace(files, robot=replace(files.robot, file=robot_file))


def with_firmware(files: Files, version: int | None) -> Files:
    """Return the files with this firmware version of all Dynamixels X; None keeps the versions of the robot file."""
    if version is None:
        return files
    joints = tuple(
        replace(one, firmware=version) if one.model in x.MODELS.values() else one for one in files.robot.joints
    )
    return replace(files, robot=replace(files.robot, joints=joints))


def with_narrow_limits(files: Files, limits: Mapping[str, tuple[float, float]]) -> Files:
    """Return the files with narrower limits (lower, upper) for some joints, in rad or m."""
    if not limits:
        return files
    narrowed = files.limits | {
        name: replace(files.limits[name], lower=lower, upper=upper) for name, (lower, upper) in limits.items()
    }
    joints = tuple(
        replace(one, limits=narrowed[one.name], stops=one.stops or (one.limits.lower, one.limits.upper))
        if one.name in limits
        else one
        for one in files.robot.joints
    )
    return replace(files, limits=narrowed, robot=replace(files.robot, joints=joints))


def end_program(stack: FaultyStack, hurry_s: float | None = None) -> None:
    """End the stack as ``servoloop up`` does with virtual servos: either hold the arm, or park and release it.

    Args:
        stack: The stack.
        hurry_s: Time until a second signal, which skips the motion to the park pose, in seconds; None for one signal.
    """
    stack.player.reach("end", stack.world.time_s)
    stack.ending = True
    second_s = math.inf if hurry_s is None else stack.clock.now() + hurry_s
    stack.end_problems = stack.control_stack.end(lambda: stack.clock.now() >= second_s)
    stack.hurried = stack.clock.now() >= second_s
    for line in stack.lines.values():
        line.advance(stack.clock.now())
