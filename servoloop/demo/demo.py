"""The demo: jobs in a cell of its own, and what they cost the stack's process."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import psutil

from drivers.errors import DriverError
from servoloop.demo.cell import Cell, cell
from servoloop.demo.jobs import Run
from servoloop.demo.live import Live

IDLE_S = 3.0
Result = TypeVar("Result")
FIGURES = (
    "cycles",
    "missed_cycles",
    "unmeasured_cycles",
    "latest_wake_up_ms",
    "longest_cycle_ms",
    "mean_cycle_ms",
)


@dataclass(frozen=True, slots=True)
class Report:
    """A demo's results."""

    runs: tuple[Run, ...]
    comparison: Run
    """One more run, with servos that leap to each goal."""
    loop: Mapping[str, float]
    cpu_percent: Mapping[str, float]


def demo(grades: Sequence[str], repeat: int, out: Path, robot: Path | None, live: Live) -> Report:
    """Run the demo; ``out`` is a folder. Raises DriverError with a process' last words if one of them fails."""
    with cell(out, robot, live) as ready:
        return _measure([grade for _ in range(repeat) for grade in grades], ready)


def _measure(jobs: Sequence[str], ready: Cell) -> Report:
    """Run all jobs, then one more without the servos' own interpolation, for the difference."""
    from nodes.manager.hardware_nodes import INTERPOLATION

    runner, monitor = ready.runner, ready.monitor
    stack = psutil.Process(ready.process_ids["stack"])
    idle_percent, _ = _cpu(stack, lambda: runner.idle(IDLE_S))
    moving_percent, runs = _cpu(stack, lambda: [runner.run(grade) for grade in jobs])
    runner.idle(1.5)  # the figures of the last cycles are published once a second
    loop = {name: float(monitor.newest.loop.get(name, "nan")) for name in FIGURES}
    if not monitor.set_parameter(ready.component, INTERPOLATION, False):
        raise DriverError("the stack does not let its servo interpolation be switched off")
    comparison = runner.run(jobs[0])
    return Report(tuple(runs), comparison, loop, {"idle": idle_percent, "moving": moving_percent})


def _cpu(process: psutil.Process, action: Callable[[], Result]) -> tuple[float, Result]:
    """Per cent of one core that the process took during the action, and the action's result."""
    process.cpu_percent()
    result = action()
    return process.cpu_percent(), result
