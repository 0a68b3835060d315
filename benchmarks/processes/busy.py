"""Run the demo without real-time priority while other programs keep the processors busy."""

import ctypes
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from rich.console import Console

from benchmarks.processes.children import kill, start
from servoloop.stack.processes import end_with_parent

CUBES: Final = 3
"""Number of cubes in one demo."""
DEMO_S: Final = 300.0
_PR_CAPBSET_DROP: Final = 24
_CAP_SYS_NICE: Final = 23


def without_priority() -> None:
    """Remove this process's right to real-time priority, and that of its children. Call this function before
    ``exec``.

    Root keeps its file access, because only CAP_SYS_NICE is removed from the bounding set. An ordinary user cannot drop
    capabilities, but loses the right that an ``rtprio`` limit would grant.
    """
    # A process that already has real-time priority would keep it despite the limit.
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, _CAP_SYS_NICE)
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    end_with_parent()


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """Run a given number of processes that only consume processor time."""
    with ExitStack() as ending:
        for _ in range(count):
            ending.callback(kill, start("-c", "while True: pass"))
        yield


def demo_beside(count: int, console: Console) -> int:
    """Run one demo alongside the busy loops, and return the number of sorted cubes."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder, busy_loops(count):
        words = _demo(folder)
        result = Path(folder) / "result.json"
        if not result.exists():
            console.print(words, highlight=False)
            return 0
        found = json.loads(result.read_text())
    for run in found["runs"]:
        if not run["success"]:
            console.print(f"grade {run['grade']}, bin {run['bin']}: {run['message']}", highlight=False)
    console.print(f"missed cycles: {found['loop']['missed_cycles']:.0f} of {found['loop']['cycles']:.0f}")
    return sum(run["success"] for run in found["runs"])


def _demo(folder: str) -> str:
    """Run the demo and return its output. The demo writes its results to the folder, unless it fails first."""
    command = [sys.executable, "-m", "servoloop", "demo", "--out", folder]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=subprocess.STDOUT, text=True, preexec_fn=without_priority) as p:
        try:
            return p.communicate(timeout=DEMO_S)[0]
        except subprocess.TimeoutExpired:
            p.kill()
            return p.communicate()[0] + f"the demo did not finish within {DEMO_S:.0f} s"


def busy(count: int, runs: int, console: Console) -> bool:
    """Run the demos and return whether all of them sorted all cubes."""
    console.print(
        f"{runs} demos without real-time priority (no CAP_SYS_NICE, RLIMIT_RTPRIO 0) while {count} busy loops run"
    )
    found = [demo_beside(count, console) for _ in range(runs)]
    console.print(f"cubes in their bins: {sum(found)} of {CUBES * runs}")
    return sum(found) == CUBES * runs
