"""Measure the speed of the simulation on one core: ``python -m benchmarks.simulation [--json]``.

There are three measurements: the world alone; the world with the servos of the virtual arm; and the whole stack, from
controllers to bytes and physics. Each result is the best of several runs, because other load can only slow down a run.
After these measurements, the first runs of the default campaign, docs/campaign.yaml, are executed with all invariants
and without any, to measure the processor time of the invariants.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

from rich.console import Console
from rich.table import Table

from benchmarks.invariants import SEEDS, InvariantCost, cost, default_scenario
from benchmarks.shared.arguments import in_words
from benchmarks.shared.stopwatch import Stopwatch
from drivers.servos import sts
from servoloop.campaign.scenario import Scenario
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.emulator import couplings, virtual_bus
from servoloop.stack.robot_files import read_files
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.world import World

RUNS = 5
STEPS = 4000
"""Number of timesteps in a run without the stack."""
MOVE_S = 2.0
SWING_RAD = 0.5
SETTLE_S = 1.0


def moving(stack: SimulatedStack) -> Callable[[], None]:
    """Return a function that moves all joints of the arm once, alternately forward and backward."""
    way = [1]

    def move() -> None:
        here = stack.arm.tracking
        assert here is not None
        pose = [float(angle) + way[0] * SWING_RAD for angle in here.reference.position]
        way[0] = -way[0]
        stack.go(pose, MOVE_S)
        stack.run(MOVE_S)

    return move


def up(wire: bool) -> SimulatedStack:
    """Start the arm at rest, as ``servoloop simulate`` does."""
    stack = SimulatedStack(wire=wire).up()
    stack.run(SETTLE_S)
    return stack


def watch(stack: SimulatedStack, stopwatch: Stopwatch) -> None:
    """Let the stopwatch measure the parts of a stack with servos."""
    stopwatch.watch("world", stack.world, "advance")
    stopwatch.watch("servos", stack.bus.rig, "step")
    stopwatch.watch("line and packets", stack.virtual_port, "read", "write", "discard_input")
    if stack.hardware.compensation is not None:
        stopwatch.watch("compensation", stack.hardware.compensation, "update")
    stopwatch.watch("driver", stack.hardware, "request", "read", "write")
    stopwatch.watch("controllers", stack.manager.cycle, "update")
    stopwatch.watch("loop", stack.loop, "run")


@dataclass(frozen=True, slots=True)
class SpeedFigures:
    """Speeds as multiples of real time, and each part's fraction of the whole stack's time."""

    world: float
    servos: float
    stack: float
    without_a_wire: float
    shares: dict[str, float]
    invariants: InvariantCost
    """Cost of a campaign's invariants."""


def best_s(step: Callable[[], None], steps: int, runs: int) -> float:
    """Return the duration of the shortest run of several, in seconds."""
    times_s = []
    for _ in range(runs):
        begin_s = time.perf_counter()
        for _ in range(steps):
            step()
        times_s.append(time.perf_counter() - begin_s)
    return min(times_s)


def world_speed(runs: int, steps: int) -> float:
    """Return the speed of the world alone, with an arm held in balance.

    An arm that has sagged onto the cube would have more contacts.
    """
    world = World()
    joints = world.arrays
    for effort_at, velocity_at in zip(joints.effort_at, joints.velocity_at, strict=True):
        joints.effort[effort_at] = world.data.qfrc_bias[velocity_at]
    return steps * world.timestep_s / best_s(world.advance, steps, runs)


def servos_speed(runs: int, steps: int) -> float:
    """Return the speed of the world with all servos and their power supply, while the servos hold the arm."""
    robot = read_files().robot
    world = World()
    line = virtual_bus(robot, WorldPlant(world, couplings(robot)))
    for servo in line.servos:
        servo.write(sts.torque_enable.address, b"\x01")
    return steps * world.timestep_s / best_s(line.rig.step, steps, runs)


def measure(runs: int = RUNS, steps: int = STEPS, scenario: Scenario | None = None, seeds: int = SEEDS) -> SpeedFigures:
    """Run all measurements.

    The fractions of the parts are measured in a separate run, because the stopwatch itself adds overhead. The first
    ``seeds`` runs of ``scenario`` are used to measure the cost of the invariants; None selects the default scenario.
    """
    stack = up(wire=True)
    move = moving(stack)
    # Both directions are measured, because one of them has more contacts.
    stack_s = best_s(move, 2, runs)
    without_s = best_s(moving(up(wire=False)), 2, runs)
    stopwatch = Stopwatch()
    watch(stack, stopwatch)
    move()
    move()
    way_s = 2 * MOVE_S
    return SpeedFigures(
        world_speed(runs, steps),
        servos_speed(runs, steps),
        way_s / stack_s,
        way_s / without_s,
        stopwatch.shares(),
        cost(scenario or default_scenario(), seeds),
    )


def show(console: Console, figures: SpeedFigures) -> None:
    """Print the results."""
    table = Table("", "times real time", title="simulation on one core")
    table.add_row("world alone", f"{figures.world:.0f}")
    table.add_row("world with servos, without driver and controllers", f"{figures.servos:.0f}")
    table.add_row("whole stack, from controllers to bytes and physics", f"{figures.stack:.0f}")
    table.add_row("whole stack with the arm in MuJoCo, without servos and bus", f"{figures.without_a_wire:.0f}")
    console.print(table)
    shares = Table("whole stack", "fraction of its time")
    for part, share in sorted(figures.shares.items(), key=lambda entry: -entry[1]):
        shares.add_row(part, f"{share:.0%}")
    console.print(shares)
    _show_cost(console, figures.invariants)


def _show_cost(console: Console, measured: InvariantCost) -> None:
    runs = f"{measured.runs} runs of a campaign"
    table = Table(runs, "processor time of a run", "ratio")
    table.add_row("without invariants", f"{measured.without_s / measured.runs:.2f} s", "1")
    table.add_row("with all invariants", f"{measured.with_all_s / measured.runs:.2f} s", f"{measured.ratio:.2f}")
    console.print(table)
    shares = Table("invariant", "fraction of the total time of all invariants")
    for name, share in sorted(measured.shares.items(), key=lambda entry: -entry[1]):
        shares.add_row(name, f"{share:.1%}")
    console.print(shares)


def main() -> None:
    """Run the measurements and print the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    arguments = parser.parse_args()
    figures = measure()
    if arguments.json:
        print(json.dumps(asdict(figures), indent=2))
    else:
        show(Console(width=100), figures)


if __name__ == "__main__":
    with in_words():
        main()
