"""One run of a campaign: a schedule from beginning to end, with all invariants looking on."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from controller.shutdown import shut_down
from drivers.errors import DriverError
from hal.errors import HalError
from hal.robot_file.robot_file import ExitPolicy
from nodes.pick_place.settings import Settings
from servoloop.campaign.invariants.watch import ALL, Invariant, Violation, Watch
from servoloop.campaign.visits import Visit
from servoloop.simulation.clients import SimulatedClients
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import run_job
from servoloop.simulation.schedule import Schedule
from servoloop.stack.robot_files import Files
from sim_backend.buses.build import Build

NO_CRASH: Final = "no crash"
"""Violated by an exception that no program may end with."""
NO_HANG: Final = "no hang"
"""Violated by a run that does not end."""
NOT_KILLED: Final = "not killed"
"""Violated by a run that ends its process."""
WHOLE_RUN: Final = (NO_CRASH, NO_HANG, NOT_KILLED)
"""Violations of a whole run, which is not looked at by invariants then."""


@dataclass(frozen=True, slots=True)
class RunReport:
    """What came of one schedule."""

    schedule: Schedule
    violations: tuple[Violation, ...]
    succeeded: int
    """Jobs whose cube is in its bin."""
    ended: str
    """Why the program ended early; empty where it did not."""
    simulated_s: float
    largest_following_rad: float | None
    """The largest following error of any joint of the arm; None where the arm was never told to move."""
    examined: Mapping[str, int] = field(default_factory=dict)
    """How often each invariant looked at its condition, by name."""
    visits: Counter[Visit] = field(default_factory=Counter)
    """Cycles, by what was wrong in which phase."""

    @property
    def seed(self) -> int:
        """The seed of a campaign's run."""
        return self.schedule.seed or 0


def run_schedule(
    files: Files,
    settings: Settings,
    schedule: Schedule,
    kinds: tuple[type[Invariant], ...] = ALL,
    prepare: Callable[[FaultyStack], None] = lambda stack: None,
) -> RunReport:
    """Run a schedule, and end the program after it. Raises FaultError where a fault cannot happen to this arm.

    ``prepare`` may change the stack before it comes up: a test plants there what an invariant is to find.
    """
    stack = FaultyStack(files=files, build=Build(schedule.backlash_deg, schedule.seed), keep_alive=True)
    stack.player.plan(schedule.faults)
    prepare(stack)
    watch, succeeded, ended = Watch(stack, kinds), 0, ""
    try:
        stack.up()
        stack.clients = SimulatedClients(stack, stack.arm, schedule.clients)
        for number, grade in enumerate(schedule.job, 1):
            succeeded += run_job(stack, settings, grade, number).success
        stack.run(schedule.seconds)
    except (DriverError, HalError) as error:  # the program ends then, as below
        ended = str(error)
    stack.clients = None
    end_program(stack, schedule.on_exit)
    watch.end()
    largest_rad = max(stack.trace.following().largest_rad, default=None)
    violations = tuple(watch.violations.values())
    return RunReport(
        *(schedule, violations, succeeded, ended, stack.clock.now(), largest_rad), watch.examined, watch.visits.cycles
    )


def lost_run(schedule: Schedule, name: str, time_s: float, text: str) -> RunReport:
    """Report a run that did not come to its end: nothing is known of it but this violation."""
    time_s = round(time_s, 4)
    return RunReport(schedule, (Violation(name, time_s, text),), 0, "", time_s, None)


def end_program(stack: FaultyStack, on_exit: ExitPolicy | None = None) -> None:
    """End as ``servoloop up`` with virtual servos does: held, or parked and let go."""
    stack.player.reach("end", stack.world.time_s)
    robot = stack.files.robot.file
    park = robot.park
    stack.relaxes = (on_exit or robot.on_exit.virtual) == "relax"
    relax, stack.ending = stack.relaxes, True
    shut_down(stack.loop, relax, park.pose if park else None, park.velocity_scale if park else 1.0)
    for line in stack.lines.values():
        line.advance(stack.clock.now())
