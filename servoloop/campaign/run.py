"""One run of a campaign: a schedule from beginning to end, with all invariants looking on."""

from collections.abc import Callable
from dataclasses import dataclass

from controller.shutdown import shut_down
from drivers.errors import DriverError
from hal.errors import HalError
from nodes.pick_place.settings import Settings
from servoloop.campaign.invariants import ALL, Invariant, Violation, Watch
from servoloop.files import Files
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import run_job
from servoloop.simulation.schedule import Schedule
from sim_backend.faults.player import require_possible
from sim_backend.mechanics.build import Build


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


def run_schedule(
    files: Files,
    settings: Settings,
    schedule: Schedule,
    kinds: tuple[type[Invariant], ...] = ALL,
    prepare: Callable[[FaultyStack], None] = lambda stack: None,
) -> RunReport:
    """Run a schedule and the end of the program behind it. Raises FaultError where a fault cannot happen to this arm.

    ``prepare`` may change the stack before it comes up: a test plants there what an invariant is to find.
    """
    stack = FaultyStack(files=files, build=Build(schedule.backlash_deg, schedule.seed), keep_alive=True)
    require_possible(schedule.faults, stack.player.targets.inventory)
    prepare(stack)
    watch, succeeded, ended = Watch(stack, kinds), 0, ""
    try:
        stack.up()
        stack.player.play(schedule.faults, stack.world.time_s)
        for number, grade in enumerate(schedule.job, 1):
            succeeded += run_job(stack, settings, grade, number).success
        stack.run(schedule.seconds)
    except (DriverError, HalError) as error:  # the program ends then, as below
        ended = str(error)
    end_program(stack)
    watch.end()
    largest_rad = max(stack.trace.following().largest_rad, default=None)
    violations = tuple(watch.violations.values())
    return RunReport(schedule, violations, succeeded, ended, stack.clock.now(), largest_rad)


def end_program(stack: FaultyStack) -> None:
    """End as ``servoloop up`` with virtual servos does: held, or parked and let go."""
    robot = stack.files.robot.file
    park = robot.park
    relax = robot.on_exit.virtual == "relax"
    shut_down(stack.loop, relax, park.pose if park else None, park.velocity_scale if park else 1.0)
    for line in stack.lines.values():
        line.advance(stack.clock.now())
