"""Measure the control loop with and without the page of ``servoloop view``: ``python -m benchmarks.view [--jobs 6]``.

The cell is the same as in ``servoloop demo``. The cell first runs without a view, and then with the page open in the
Chromium browser of this machine. The browser renders without a graphics card and has the lowest priority
(benchmarks/processes/browser.py).

Two periods are measured during the jobs: the time between the starts of two cycles, and the time between two
measurements. Both are reported as deviations from the configured period. The second period includes the delays of the
kernel and the virtual servos. In 24 jobs, p99.9 depends on the five worst cycles. ``--rounds 3`` alternates between
runs with and without the page, and compares the cycles across all runs.
"""

import argparse
import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.processes.browser import PATIENCE_MS, browser_page
from benchmarks.shared.arguments import in_words, positive
from hal.types import FloatArray
from servoloop.demo.cell import ADDRESS, Cell, cell
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import Live
from servoloop.recording.reader import read_recording

PERIOD_S: Final = 0.05
GRADES: Final = "ABC"
LOOP: Final = ("cycles", "missed_cycles", "latest_wake_up_ms")
QUANTILES: Final = (0.5, 0.99, 0.999, 1.0)


@dataclass(slots=True)
class ViewOutcome:
    """Jobs of one run, with the timing of the loop."""

    view: bool
    jobs: int = 0
    sorted: int = 0
    loop: dict[str, str] = field(default_factory=dict)
    """Statistics of the loop from /diagnostics."""
    stamps_s: list[float] = field(default_factory=list)
    """ROS times of the measurements of all jobs, in seconds."""
    measured_s: list[float] = field(default_factory=list)
    """Deviations of the time between two measurements of the same job, in seconds."""
    begun_s: FloatArray = field(default_factory=lambda: np.empty(0))
    """Deviations of the time between the starts of two cycles, in seconds."""
    browser_s: float = 0.0
    """Processor time of the browser and its child processes, in seconds."""


def measure(view: bool, jobs: int, folder: Path, console: Console) -> ViewOutcome:
    """Run ``jobs`` jobs in a new cell."""
    found, recording = ViewOutcome(view), folder / "run.mcap"
    options = CellOptions(folder, backlash_deg=0.0, record=recording, view=view)
    with Live(console) as live, cell(options, live) as ready:
        if not view:
            _run_jobs(found, ready, jobs)
        else:
            with page(ADDRESS.findall((folder / "view.log").read_text())[0]) as used_s:
                _run_jobs(found, ready, jobs)
                found.browser_s = used_s()
    run = read_recording(recording)
    at_s = run.begin_s + run.cycle_s
    late_s = run.late_s[(at_s >= found.stamps_s[0]) & (at_s <= found.stamps_s[-1])]
    found.begun_s = np.abs(np.diff(late_s))
    return found


@contextmanager
def page(address: str) -> Iterator[Callable[[], float]]:
    """Open the page in a browser, and wait until the page shows the arm.

    Yields:
        Function that returns the browser's processor time since this call, in seconds.
    """
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("chromium is not on PATH: install it with apt-get install chromium")
    with browser_page(chromium, stand_back=True) as shown:
        shown.goto(address)
        shown.wait_for_selector("canvas", timeout=PATIENCE_MS)
        shown.wait_for_function("document.body.innerText.includes('joint1 (servo 1)')", timeout=PATIENCE_MS)
        before_s = _browser_s()
        yield lambda: _browser_s() - before_s


def _browser_s() -> float:
    """Return the processor time of all browser processes."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # The process has exited.
            name, values = stat.read_text().rsplit(")", 1)
            ticks += sum(map(int, values.split()[11:13])) if "(chrom" in name else 0
    return ticks / os.sysconf("SC_CLK_TCK")


def _run_jobs(found: ViewOutcome, ready: Cell, jobs: int) -> None:
    ready.runner.idle(2.0)
    for number in range(jobs):
        run = ready.runner.run(GRADES[number % len(GRADES)])
        found.jobs += 1
        found.sorted += run.success
        stamps_s = [sample.stamp_s for sample in ready.monitor.newest.samples]
        found.stamps_s += stamps_s
        found.measured_s += list(np.abs(np.diff(stamps_s) - PERIOD_S))
    ready.runner.idle(2.0)  # the loop reports once per second
    found.loop = ready.monitor.newest.loop


def show(console: Console, outcomes: list[ViewOutcome]) -> None:
    """Print one row per run, and the ratios of all runs with the page to all runs without it."""
    table = Table(
        *("page", "cubes", "cycles", "missed", "latest, ms", "start deviation, us", "read deviation, us", "browser, s")
    )
    for one in outcomes:
        counted = f"{one.sorted} of {one.jobs}", *(one.loop.get(name, "?") for name in LOOP)
        off = (
            " / ".join(f"{1e6 * value:.0f}" for value in np.quantile(deviations, QUANTILES))
            for deviations in (one.begun_s, one.measured_s)
        )
        table.add_row("open" if one.view else "none", *counted, *off, f"{one.browser_s:.0f}")
    console.print(table)
    begun = _ratio([(one.view, one.begun_s) for one in outcomes])
    measured = _ratio([(one.view, np.array(one.measured_s)) for one in outcomes])
    console.print(
        "deviations of the period: p50 / p99 / p99.9 / largest. Over all cycles, opening the page multiplies p99.9 by "
        f"{begun} from cycle start to cycle start, and by {measured} from measurement to measurement"
    )


def _ratio(deviations_s: list[tuple[bool, FloatArray]]) -> str:
    """Return the p99.9 of all timing deviations with the page, divided by the p99.9 of those without it."""
    shown, hidden = (
        np.quantile(np.concatenate([own for view, own in deviations_s if view is wanted]), 0.999)
        for wanted in (True, False)
    )
    return f"{shown / hidden:.2f}"


def main() -> None:
    """Run the measurements and print the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--jobs", type=positive, default=6, help="number of jobs in each run")
    parser.add_argument(
        "--rounds",
        type=positive,
        default=1,
        help="number of rounds, each with one run without the page and one run with it",
    )
    arguments = parser.parse_args()
    console = Console(width=120)
    outcomes = []
    for view in (False, True) * arguments.rounds:
        with tempfile.TemporaryDirectory(prefix="bench-") as folder:
            outcomes.append(measure(view, arguments.jobs, Path(folder), console))
    show(console, outcomes)


if __name__ == "__main__":
    with in_words():
        main()
