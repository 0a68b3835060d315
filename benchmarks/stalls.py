"""Run the demo's jobs while its processes are paused repeatedly: ``python -m benchmarks.stalls [--jobs 10]``.

The cell is the same as in ``servoloop demo``: emulator, stack and pick-and-place node, each in a separate process. At
random times, the stack, the emulator or both are paused for 0.05 to 0.2 s, as if a laptop or a USB hub stalled. Ten
jobs run for each of these cases. With ``--busy 4``, no process is paused. Instead, the whole demo runs as an ordinary
program without real-time priority while four busy loops use the processors. The exit status is 1 if a cube is not in
its bin or a joint has jumped.
"""

import argparse
import contextlib
import os
import random
import signal
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.processes.busy import busy
from benchmarks.shared.arguments import positive
from servoloop.demo.cell import Cell, cell
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import Live
from servoloop.stack.processes import LOOP_PRIORITY
from servoloop.stack.robot_files import read_files
from sim_backend.scene.world_feed import WorldFeedClient, feed_path

SIDES: Final[Mapping[str, Sequence[str]]] = {
    "stack": ("stack",),
    "emulator": ("emulator",),
    "both": ("stack", "emulator"),
}
STALL_S: Final = (0.05, 0.2)
PAUSE_S: Final = (0.3, 2.0)
"""Shortest and longest time between two stalls, in seconds. A job takes about eleven seconds."""
STEP_S: Final = 0.05
"""Time over which the step of a joint is measured, in seconds. If two publications are further apart, the time between
them is used instead."""
LARGEST_STEP: Final = 1.15
"""Maximum allowed step of a joint, as a multiple of its velocity limit.

A servo moves 5 % faster than its goals, to catch up with its lag. In addition, the feed's timestamps may be off by one
tick of the emulator: 5 ms in a step of 50 ms.
"""
GRADES: Final = "ABC"


class Stalls:
    """Thread that pauses processes at random times until ``end`` is called, and measures the joint speeds."""

    def __init__(self, process_ids: Sequence[int], seed: int, watch: "JointSteps") -> None:
        self.lasted_s: list[float] = []
        self._process_ids = process_ids
        self._random = random.Random(seed)
        self._watch = watch
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="stalls", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End the stalls."""
        self._stop.set()
        self._thread.join()
        self._watch.look()

    def _run(self) -> None:
        with contextlib.suppress(PermissionError):  # The duration of a stall should be exact.
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(LOOP_PRIORITY))
        while not self._stop.wait(self._random.uniform(*PAUSE_S)):
            begin_s = time.monotonic()
            try:
                for process_id in self._process_ids:
                    os.kill(process_id, signal.SIGSTOP)
                time.sleep(self._random.uniform(*STALL_S))
            finally:
                for process_id in self._process_ids:
                    os.kill(process_id, signal.SIGCONT)
            self.lasted_s.append(time.monotonic() - begin_s)
            self._watch.look()


class Feed(Protocol):
    """The emulator's publications, as ``WorldFeedClient`` reads them."""

    def all(self) -> list[dict[str, Any]]: ...


class JointSteps:
    """Largest step of any joint of the simulated arm, as a multiple of the joint's velocity limit."""

    def __init__(self, feed: Feed, limits: Mapping[str, float]) -> None:
        """``limits`` contains the velocity limits in rad/s or m/s, keyed by joint name."""
        self.largest = 0.0
        self.joint = ""
        self._feed = feed
        self._limits = limits
        self._joints: list[str] = []
        self._rows: list[tuple[float, list[float]]] = []

    def look(self) -> None:
        """Evaluate all world publications since the last call."""
        for publication in self._feed.all():
            self._joints = list(publication["joints"])
            self._rows += [(time_s, positions) for time_s, positions in publication["trace"]]
        if len(self._rows) < 2:
            return
        times_s = np.array([time_s for time_s, _ in self._rows])
        positions = np.array([row for _, row in self._rows])
        ends = np.searchsorted(times_s, times_s + STEP_S - 1e-4)
        begins = np.flatnonzero(ends < len(times_s))
        ends = ends[begins]
        if not len(ends):
            return
        limits = np.array([self._limits[name] for name in self._joints])
        share = np.abs(positions[ends] - positions[begins]) / limits / (times_s[ends] - times_s[begins])[:, None]
        if share.max() > self.largest:
            self.largest, self.joint = float(share.max()), self._joints[int(share.max(axis=0).argmax())]
        self._rows = self._rows[int(begins[-1]) :]


@dataclass(slots=True)
class StallOutcome:
    """Results of all jobs in one case."""

    side: str
    lasted_s: list[float] = field(default_factory=list)
    """Duration of each stall."""
    jobs: int = 0
    sorted: int = 0
    missed_cycles: str = ""
    largest_step: float = 0.0
    joint: str = ""
    texts: list[str] = field(default_factory=list)


def measure(side: str, jobs: int, seed: int, folder: Path, console: Console) -> StallOutcome:
    """Run a number of jobs in a new cell while the processes of this case are paused repeatedly."""
    with Live(console) as live, cell(CellOptions(folder, backlash_deg=0.0), live) as ready:
        return _measure(side, jobs, seed, folder, ready)


def _measure(side: str, jobs: int, seed: int, folder: Path, ready: Cell) -> StallOutcome:
    limits = {name: limit.velocity for name, limit in read_files().limits.items()}
    steps = JointSteps(WorldFeedClient(feed_path(folder / "bus")), limits)
    ready.runner.idle(1.0)
    stalls = Stalls([ready.process_ids[name] for name in SIDES[side]], seed, steps)
    found = StallOutcome(side)
    try:
        for number in range(jobs):
            run = ready.runner.run(GRADES[number % len(GRADES)])
            found.jobs += 1
            found.sorted += run.success
            if not run.success:
                found.texts.append(f"grade {run.grade}, bin {run.bin}: {run.message}")
    finally:
        stalls.end()
    ready.runner.idle(2.0)  # the loop reports once per second
    found.lasted_s = stalls.lasted_s
    found.missed_cycles = ready.monitor.newest.loop.get("missed_cycles", "?")
    found.largest_step, found.joint = steps.largest, steps.joint
    return found


def show(console: Console, outcomes: Sequence[StallOutcome]) -> None:
    """Print one row per case, and the messages of failed jobs."""
    table = Table(title="jobs while processes are stopped for 0.05 to 0.2 s")
    for title in ("side", "stalls", "longest, s", "cubes", "missed cycles", "largest step / velocity limit"):
        table.add_column(title)
    for one in outcomes:
        step = f"{one.largest_step:.2f} ({one.joint})"
        cubes = f"{one.sorted} of {one.jobs}"
        longest = f"{max(one.lasted_s, default=0.0):.3f}"
        table.add_row(one.side, str(len(one.lasted_s)), longest, cubes, one.missed_cycles, step)
    console.print(table)
    for one in outcomes:
        for text in one.texts:
            console.print(f"{one.side}: {text}", highlight=False)
    console.print(f"cubes in their bins: {sum(o.sorted for o in outcomes)} of {sum(o.jobs for o in outcomes)}")


def stalls(sides: Sequence[str], jobs: int, seed: int, console: Console) -> bool:
    """Run all cases. Return whether all jobs sorted their cubes and no joint jumped."""
    outcomes = []
    for side in sides:
        with tempfile.TemporaryDirectory(prefix="bench-") as folder:
            outcomes.append(measure(side, jobs, seed, Path(folder), console))
    show(console, outcomes)
    return all(one.sorted == one.jobs and one.largest_step <= LARGEST_STEP for one in outcomes)


def main() -> int:
    """Measure, print the results and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--jobs", type=positive, default=10, help="number of jobs for each side")
    parser.add_argument(
        "--side", choices=tuple(SIDES), action="append", help="processes to stall (default: each case in turn)"
    )
    parser.add_argument("--seed", type=int, default=1, help="random seed for the stall times and durations")
    parser.add_argument(
        "--busy",
        type=positive,
        metavar="LOOPS",
        help="run the demo with this number of busy loops instead of stalls",
    )
    parser.add_argument("--runs", type=positive, default=5, help="number of demos to run with busy loops")
    arguments = parser.parse_args()
    console = Console(width=120)
    if arguments.busy:
        return 0 if busy(arguments.busy, arguments.runs, console) else 1
    return 0 if stalls(arguments.side or tuple(SIDES), arguments.jobs, arguments.seed, console) else 1


if __name__ == "__main__":
    raise SystemExit(main())
