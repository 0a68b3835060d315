"""The demo: jobs in a cell of its own, and what they cost the stack's process."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

import psutil

from drivers.errors import DriverError
from servoloop.arms.folder import Arm
from servoloop.demo.cell import ARM, Cell, are_all_grades, cell
from servoloop.demo.jobs import Run
from servoloop.demo.live import Live
from sim_backend.mechanics.build import Build

IDLE_S = 3.0
FADING_S = 1.5
"""So long gravity compensation takes to come and go."""
SAGGING_RAD = 0.2
"""The goal tolerance of the run without gravity compensation: the sag alone is more than the usual one."""
HARDWARE = ""
"""Stands for the hardware component's node."""
EACH_JOINT = "constraints.{joint}.goal"
"""Stands for this parameter of every joint of the arm."""
WITHOUT: Final[Mapping[str, Sequence[tuple[str, str, bool | float]]]] = {
    "gravity compensation": [
        (ARM, EACH_JOINT, SAGGING_RAD),
        (HARDWARE, "gravity_compensation", False),
    ],
    "lead": [(HARDWARE, "gravity_compensation", True), (ARM, "command_lead", 0.0)],
}
"""The parameters to set, node, name and value, for each run without something that soft servos need."""
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

    joints: tuple[str, ...]
    """The arm's, in the order of all figures."""
    runs: tuple[Run, ...]
    comparisons: Mapping[str, Run]
    """More runs, by what is missing in each; none where not all grades were asked for. They need not succeed."""
    loop: Mapping[str, float]
    cpu_percent: Mapping[str, float]


def demo(
    grades: Sequence[str],
    repeat: int,
    out: Path,
    arm: Arm,
    robot: Path | None,
    build: Build,
    live: Live,
    record: Path | None = None,
    view: bool = False,
) -> Report:
    """Run the demo; ``out`` is a folder, ``record`` a new file for the stack's recording.
    With ``view`` the arm is shown in a browser meanwhile.

    Raises DriverError with a process' last words if one of them fails.
    """
    with cell(out, arm, robot, build, live, record, view) as ready:
        return _measure([grade for _ in range(repeat) for grade in grades], ready, are_all_grades(grades, arm))


def _measure(jobs: Sequence[str], ready: Cell, compare: bool) -> Report:
    """Run all jobs; to ``compare``, one more without each help that soft servos get."""
    runner, monitor = ready.runner, ready.monitor
    stack = psutil.Process(ready.process_ids["stack"])
    idle_percent, _ = _cpu(stack, lambda: runner.idle(IDLE_S))
    moving_percent, runs = _cpu(stack, lambda: [runner.run(grade) for grade in jobs])
    runner.idle(1.5)  # the figures of the last cycles are published once a second
    loop = {name: float(monitor.newest.loop.get(name, "nan")) for name in FIGURES}
    comparisons = {what: _run_without(what, jobs[0], ready) for what in WITHOUT if compare}
    return Report(tuple(ready.joints), tuple(runs), comparisons, loop, {"idle": idle_percent, "moving": moving_percent})


def _run_without(what: str, grade: str, ready: Cell) -> Run:
    """One more run, with other parameters than before."""
    for node, name, value in WITHOUT[what]:
        node = node or ready.component
        for each in [name.format(joint=joint) for joint in ready.joints] if name == EACH_JOINT else [name]:
            if not ready.monitor.set_parameter(node, each, value):
                raise DriverError(f"the stack does not let {each} of {node} be set")
    ready.runner.idle(FADING_S)
    return ready.runner.run(grade)


def _cpu(process: psutil.Process, action: Callable[[], Result]) -> tuple[float, Result]:
    """Per cent of one core that the process took during the action, and the action's result."""
    process.cpu_percent()
    result = action()
    return process.cpu_percent(), result
