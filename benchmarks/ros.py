"""Measure the cost and the response times of the ROS 2 interface: ``python -m benchmarks.ros [--seconds 600]``.

The stack runs as users start it (``servoloop up --hardware mock`` at 20 Hz), in a separate process. This process is the
only client. It has real-time priority if the system allows this, so that the client's own delays are not measured.

First, one subscriber receives /joint_states while the arm is at rest, to measure CPU and memory. Goals then run one
after the other for ``--seconds``, and the benchmark measures the response time, the start of the motion, and the
regularity of the /joint_states stamps. Every third goal is canceled during the motion. For comparison, the last column
shows the results of ros2_control from another machine with two cores.
"""

import argparse
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from control_msgs.action import FollowJointTrajectory
from rich.console import Console
from rich.table import Table

from nodes.clients import timing_client
from nodes.clients.client_node import client_node
from nodes.clients.timing_client import Promptness, TimedController, TimingClient
from nodes.discovery import stay_on_this_machine
from servoloop.stack.processes import claim_realtime_priority, end, end_with_parent

JOINTS = [f"joint{i}" for i in range(1, 7)]
HERE = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
THERE = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
PATIENCE_S = timing_client.PATIENCE_S
SETTLE_S = 2.0
UPSTREAM = {
    "CPU, % of a core": "1.2",
    "memory, MB": "57",
    "goal to answer, ms": "1.7 / - / 5.6",
    "goal to first motion, ms": "75 to 81 / - / 101",
    "period's deviation, us": "39 / 168 / 594 / 598 (real-time: 19 / 98 / 191 / 196)",
}
"""Results of ros2_control 4.46 in C++ with GenericSystem, recorded on another machine and not in this run."""


@dataclass(slots=True)
class RosSideFigures(Promptness):
    """All measured values, in seconds, except for ``cpu_share`` (of a core) and ``memory_mb``."""

    cpu_share: float = 0.0
    busy_cpu_share: float = 0.0
    memory_mb: float = 0.0


def goal_to(position: Sequence[float], seconds: float) -> FollowJointTrajectory.Goal:
    """Return a goal (rad) with one trajectory point for the joints of the arm."""
    return timing_client.goal_to(JOINTS, position, seconds)


@contextmanager
def stack() -> Iterator[psutil.Process]:
    """Run ``servoloop up`` on mock hardware in a separate ROS domain, ready for goals."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        settings = {"ROS_DOMAIN_ID": str(random.randint(1, 100))}
        stay_on_this_machine(settings)
        before = {name: os.environ.get(name) for name in settings}
        os.environ |= settings  # this also applies to the participants in this process
        ready, log = Path(folder) / "ready", Path(folder) / "log"
        command = [sys.executable, "-m", "servoloop", "up", "--hardware", "mock", "--ready-file", str(ready)]
        with log.open("wb") as out:
            process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, preexec_fn=end_with_parent)
        try:
            deadline_s = time.monotonic() + PATIENCE_S
            while not ready.exists():
                assert process.poll() is None, log.read_text()
                assert time.monotonic() < deadline_s, f"the stack did not become ready within {PATIENCE_S:.0f} s"
                time.sleep(0.05)
            yield psutil.Process(process.pid)
        finally:
            end(process)
            for name, value in before.items():
                os.environ.pop(name)
                os.environ |= {name: value} if value is not None else {}


def measure(idle_s: float, goals_s: float) -> RosSideFigures:
    """Run all measurements."""
    figures = RosSideFigures()
    with stack() as process, client_node("bench_ros") as (node, executor):
        client = TimingClient(node, executor, TimedController(JOINTS), figures)
        client.spin(SETTLE_S)
        figures.cpu_share = _cpu_share(process, lambda: client.spin(idle_s))
        client.recording = True
        figures.busy_cpu_share = _cpu_share(process, lambda: _goals(client, goals_s))
        figures.memory_mb = process.memory_info().rss / 1e6
    return figures


def _cpu_share(process: psutil.Process, during: Any) -> float:
    before, begin_s = process.cpu_times(), time.perf_counter()
    during()
    after, end_s = process.cpu_times(), time.perf_counter()
    return float(after.user + after.system - before.user - before.system) / (end_s - begin_s)


def _goals(client: TimingClient, seconds: float) -> None:
    end_s = time.perf_counter() + seconds
    count = 0
    while time.perf_counter() < end_s:
        count += 1
        target = HERE if count % 2 else THERE
        client.go(target, 2.5, cancel_after_s=random.uniform(0.2, 0.8) if count % 3 == 0 else None)


def _quantiles(values: Sequence[float], scale: float, shares: Sequence[float]) -> str:
    ordered = sorted(values)
    found = [ordered[min(len(ordered) - 1, int(share * len(ordered)))] for share in shares] + ordered[-1:]
    return " / ".join(f"{value * scale:.3g}" for value in found) if ordered else "-"


def show(console: Console, figures: RosSideFigures) -> None:
    """Print the results as a table."""
    periods = [b - a for a, b in zip(figures.stamps_s, figures.stamps_s[1:], strict=False)]
    middle_s = statistics.median(periods)
    deviations = [abs(period - middle_s) for period in periods]
    rows = {
        "CPU, % of a core": f"{figures.cpu_share * 100:.1f} at rest, {figures.busy_cpu_share * 100:.1f} with goals",
        "memory, MB": f"{figures.memory_mb:.0f}",
        "goal to answer, ms": _quantiles(figures.answers_s, 1e3, (0.5, 0.99)),
        "cancel to answer, ms": _quantiles(figures.cancels_s, 1e3, (0.5, 0.99)),
        "goal to first motion, ms": _quantiles(figures.motions_s, 1e3, (0.5, 0.99)),
        "period's deviation, us": _quantiles(deviations, 1e6, (0.5, 0.99, 0.999)),
    }
    table = Table("p50 / p99 (/ p99.9) / largest", "servoloop", "ros2_control, recorded", title="ROS 2 interface")
    for name, value in rows.items():
        table.add_row(name, value, UPSTREAM.get(name, "-"))
    console.print(table)
    console.print(
        f"{figures.goals} goals, {figures.failed} failed; {len(periods) + 1} joint states, "
        f"median period {middle_s * 1e3:.3f} ms"
    )


def main() -> None:
    """Run the measurements and print the results."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=600.0, help="duration of the phase with goals, in seconds")
    parser.add_argument("--idle", type=float, default=30.0, help="duration of the measurement at rest, in seconds")
    arguments = parser.parse_args()
    random.seed(1)
    claim_realtime_priority()
    show(Console(width=130), measure(arguments.idle, arguments.seconds))


if __name__ == "__main__":
    main()
