"""Run several stacks, each with one virtual arm on its own port: ``python -m benchmarks.several_stacks``.

Each stack is a process of ``servoloop up`` at 20 Hz, with ROS, in its own ROS domain. The seven servos of each arm
reply on a pseudo-terminal at 1 Mbit/s, in a separate process, whose processor time is not counted.

The last line estimates how many of these stacks a small computer can run. The estimate assumes that a core of the small
computer needs ``--slower`` times the processor time of a core of this machine. The stacks may use the fraction
``--load`` of the small computer's cores.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import Final

import psutil
from rich.console import Console
from rich.table import Table

from benchmarks.processes.stack_rates import stack
from benchmarks.rates import served
from benchmarks.shared.arguments import in_words, positive
from nodes.clients.client_node import client_node
from nodes.clients.stack_monitor import StackMonitor

RATE_HZ: Final = 20
FIRST_DOMAIN: Final = 21
SETTLE_S: Final = 3.0
"""Delay after the start of the last stack before the measurement begins, in seconds."""
PATIENCE_S: Final = 30.0
"""Maximum time until a stack's first diagnostics arrive, in seconds."""


@dataclass(frozen=True, slots=True)
class StackUsage:
    """Counters of one stack at a given time."""

    time_s: float
    cpu_s: float
    cycles: int
    missed: int


@dataclass(frozen=True, slots=True)
class MeasuredStack:
    """Process of a stack, with its ROS domain."""

    process: psutil.Process
    domain: int

    def snapshot(self) -> StackUsage:
        """Read the counters of the control loop from its diagnostics, which are published once per second."""
        os.environ["ROS_DOMAIN_ID"] = str(self.domain)
        with client_node("benchmark_several_stacks") as (node, executor):
            monitor = StackMonitor(node, executor, "arm_controller")
            end_s = time.monotonic() + PATIENCE_S
            while not monitor.newest.loop:
                if time.monotonic() > end_s:
                    raise SystemExit(f"the stack in domain {self.domain} has not published any diagnostics")
                monitor.spin(0.1)
            loop = monitor.newest.loop
            used = self.process.cpu_times()
            return StackUsage(
                time.monotonic(), used.user + used.system, int(loop["cycles"]), int(loop["missed_cycles"])
            )


@contextmanager
def stacks(count: int) -> Iterator[list[MeasuredStack]]:
    """Run the stacks and the servos of their arms."""
    with ExitStack() as entered:
        home = Path(entered.enter_context(tempfile.TemporaryDirectory()))
        running = []
        for number in range(count):
            folder = home / str(number)
            folder.mkdir()
            device = entered.enter_context(served(folder / "line"))
            domain = FIRST_DOMAIN + number
            process = entered.enter_context(stack(device, RATE_HZ, folder, domain))
            running.append(MeasuredStack(process, domain))
        yield running


def main() -> None:
    """Run the measurements and print the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--stacks", type=positive, default=10)
    parser.add_argument("--seconds", type=float, default=60.0, help="duration of the measurement")
    parser.add_argument("--slower", type=float, default=4.0, help="how many times slower the small computer is")
    parser.add_argument("--cores", type=positive, default=4, help="cores of the small computer")
    parser.add_argument("--load", type=float, default=0.5, help="fraction of these cores that the stacks may use")
    arguments = parser.parse_args()
    with stacks(arguments.stacks) as running:
        time.sleep(SETTLE_S)
        before = [one.snapshot() for one in running]
        time.sleep(arguments.seconds)
        after = [one.snapshot() for one in running]
    table = Table("stack", "cycles", "missed cycles", "CPU", title=f"{arguments.stacks} stacks at {RATE_HZ} Hz")
    shares = []
    for number, (old, new) in enumerate(zip(before, after, strict=True), 1):
        shares.append((new.cpu_s - old.cpu_s) / (new.time_s - old.time_s))
        table.add_row(str(number), str(new.cycles - old.cycles), str(new.missed - old.missed), f"{shares[-1]:.1%}")
    console = Console(width=100)
    console.print(table)
    share = mean(shares)
    possible = int(arguments.cores * arguments.load / (share * arguments.slower))
    console.print(
        f"Each stack uses {share:.1%} of a core on average. A computer with {arguments.cores} cores that are "
        f"{arguments.slower:g} times slower can run {possible} stacks if the stacks may use {arguments.load:.0%} "
        "of its processor time."
    )


if __name__ == "__main__":
    with in_words():
        main()
