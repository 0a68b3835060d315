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
SAGGING_RAD = 0.2
"""The goal tolerance of the run without gravity compensation."""
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
    """One more run, without gravity compensation. It need not succeed."""
    loop: Mapping[str, float]
    cpu_percent: Mapping[str, float]


def demo(grades: Sequence[str], repeat: int, out: Path, robot: Path | None, live: Live) -> Report:
    """Run the demo; ``out`` is a folder. Raises DriverError with a process' last words if one of them fails."""
    with cell(out, robot, live) as ready:
        return _measure([grade for _ in range(repeat) for grade in grades], ready)


def _measure(jobs: Sequence[str], ready: Cell) -> Report:
    """Run all jobs, then one more without gravity compensation, for the difference."""
    from nodes.manager.hardware_nodes import COMPENSATION

    runner, monitor = ready.runner, ready.monitor
    stack = psutil.Process(ready.process_ids["stack"])
    idle_percent, _ = _cpu(stack, lambda: runner.idle(IDLE_S))
    moving_percent, runs = _cpu(stack, lambda: [runner.run(grade) for grade in jobs])
    runner.idle(1.5)  # the figures of the last cycles are published once a second
    loop = {name: float(monitor.newest.loop.get(name, "nan")) for name in FIGURES}
    # The sag alone is more than the goal tolerance.
    tolerances = [("arm_controller", f"constraints.joint{i}.goal", SAGGING_RAD) for i in range(1, 7)]
    for node, name, value in (*tolerances, (ready.component, COMPENSATION, False)):
        if not monitor.set_parameter(node, name, value):
            raise DriverError(f"the stack does not let {name} of {node} be set")
    runner.idle(1.5)  # it fades out
    comparison = runner.run(jobs[0])
    return Report(tuple(runs), comparison, loop, {"idle": idle_percent, "moving": moving_percent})


def _cpu(process: psutil.Process, action: Callable[[], Result]) -> tuple[float, Result]:
    """Per cent of one core that the process took during the action, and the action's result."""
    process.cpu_percent()
    result = action()
    return process.cpu_percent(), result
