"""Run the demo: execute jobs in a new cell, and measure the motion, the control loop and the CPU load."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import psutil
from rich.console import Console
from rich.table import Table
from rich.text import Text

from commissioning.atomic_write import write_file
from drivers.driver_errors import DriverError
from servoloop.demo.cell import ARM, Cell, are_all_grades, cell
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import JobRun, Live
from servoloop.recording.following_error import worst
from servoloop.stack import tables

if TYPE_CHECKING:
    from nodes.clients.stack_monitor import StackMonitor

IDLE_S = 3.0
FIGURES_S = 1.5
"""Maximum time until the statistics of the latest cycles are published, in seconds."""
FADING_S = 1.5
"""Maximum time that gravity compensation takes to fade in or out, in seconds."""
SAGGING_RAD = 0.2
"""Goal tolerance without gravity compensation, in rad. The sag alone exceeds the usual tolerance."""
HARDWARE = ""
"""Placeholder for the node of the hardware component."""
EACH_JOINT = "constraints.{joint}.goal"
"""Placeholder for the goal tolerance of each joint of the arm."""
WITHOUT: Final[Mapping[str, Sequence[tuple[str, str, bool | float]]]] = {
    "gravity compensation": [
        (ARM, EACH_JOINT, SAGGING_RAD),
        (HARDWARE, "gravity_compensation", False),
    ],
    "lead": [(HARDWARE, "gravity_compensation", True), (ARM, "command_lead", 0.0)],
}
"""Parameters (node, name and value) that disable each compensation in its comparison run."""
LOOP_COLUMNS: Final = ("cycles", "missed", "unmeasured", "latest wake-up", "longest cycle", "CPU idle", "CPU moving")
EXPLANATION: Final = (
    "Each error is given for the worst joint, then for the fastest joint. The RMS error is measured while moving, and "
    "the error at rest is measured half a second after a motion."
)
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
class DemoReport:
    """Results of a demo."""

    joints: tuple[str, ...]
    """Joints of the arm, in the order of all values."""
    runs: tuple[JobRun, ...]
    comparisons: Mapping[str, JobRun]
    """Comparison runs, keyed by the disabled compensation.

    These runs take place only if all grades were picked without a planner. They do not have to succeed.
    """
    loop: Mapping[str, float]
    cpu_percent: Mapping[str, float]


def demo(
    grades: Sequence[str],
    repeat: int,
    options: CellOptions,
    live: Live,
) -> DemoReport:
    """Pick cubes of these grades ``repeat`` times in a new cell.

    Raises DriverError if a process fails. The message contains the last output of the process.
    """
    jobs = [grade for _ in range(repeat) for grade in grades]
    with cell(options, live) as ready:
        return _measure(jobs, ready, are_all_grades(grades, options.found()) and not options.poses)


def loop_figures(monitor: "StackMonitor") -> dict[str, float]:
    """Return the statistics of the control loop, which are published once per second."""
    return {name: float(monitor.newest.loop.get(name, "nan")) for name in FIGURES}


def _measure(jobs: Sequence[str], ready: Cell, compare: bool) -> DemoReport:
    """Run all jobs. If ``compare`` is set, also run one job for each compensation with that compensation disabled."""
    runner = ready.runner
    stack = psutil.Process(ready.process_ids["stack"])
    idle_percent, _ = cpu_load(stack, lambda: runner.idle(IDLE_S))
    moving_percent, runs = cpu_load(stack, lambda: [runner.run(grade) for grade in jobs])
    runner.idle(FIGURES_S)
    loop = loop_figures(ready.monitor)
    comparisons = {what: _run_without(what, jobs[0], ready) for what in WITHOUT if compare}
    return DemoReport(
        tuple(ready.joints), tuple(runs), comparisons, loop, {"idle": idle_percent, "moving": moving_percent}
    )


def _run_without(what: str, grade: str, ready: Cell) -> JobRun:
    """Run a job with the compensation ``what`` disabled."""
    for node, name, value in WITHOUT[what]:
        node = node or ready.component
        for each in [name.format(joint=joint) for joint in ready.joints] if name == EACH_JOINT else [name]:
            if not ready.monitor.set_parameter(node, each, value):
                raise DriverError(f"the stack did not set the parameter {each} of {node}")
    ready.runner.idle(FADING_S)
    return ready.runner.run(grade)


def cpu_load(process: psutil.Process, action: Callable[[], Result]) -> tuple[float, Result]:
    """Return the CPU load of a process during an action, as a percentage of one core, and the result of the action."""
    process.cpu_percent()
    result = action()
    return process.cpu_percent(), result


def write_json(report: DemoReport, path: Path) -> None:
    """Write the report as JSON. Raises DriverError if the file cannot be written."""
    write_file(path, json.dumps(_content(report), indent=2, allow_nan=False) + "\n", keep=False)


def succeeded(report: DemoReport) -> bool:
    """Return whether every cube is in the bin for its grade."""
    return bool(report.runs) and all(run.success for run in report.runs)


def print_table(report: DemoReport, console: Console) -> None:
    """Print the report as tables."""
    table = runs_table(report.runs, report.joints, "following error, rad")
    table.add_section()
    marks = {what: "*" * count for count, what in enumerate(report.comparisons, 1)}
    for what, run in report.comparisons.items():
        grade, *rest = _cells(run, report.joints)
        table.add_row(f"{grade} {marks[what]}", *rest)
    tables.print_table(console, table)
    console.print(EXPLANATION)
    if marks:
        console.print(", ".join(f"{mark}: without {what}" for what, mark in marks.items()))
    console.print()
    tables.print_table(console, loop_table(report.loop, report.cpu_percent), *LOOP_COLUMNS)
    print_summary(report.runs, console)


def runs_table(runs: Iterable[JobRun], joints: Sequence[str], title: str) -> Table:
    """Return a table with one row per job."""
    columns = ("grade", "bin", "time", "largest", "RMS", "at rest", "fastest joint", "largest", "RMS")
    table = Table(*columns, title=title)
    for column in (*table.columns[2:6], *table.columns[7:]):
        column.justify = "right"
    for run in runs:
        table.add_row(*_cells(run, joints))
    return table


def print_summary(runs: Sequence[JobRun], console: Console) -> None:
    """Print how many cubes are in the correct bins, and which objects the arms touched."""
    console.print(f"cubes in their bins: {sum(run.success for run in runs)} of {len(runs)}")
    touched = sorted({contact for run in runs for contact in run.contacts})
    console.print(f"contacts of the arm, except with the cube: {', '.join(touched) or 'none'}")


def loop_table(loop: Mapping[str, float], cpu: Mapping[str, float]) -> Table:
    """Return a table with the statistics of the control loop and its CPU load."""
    table = Table(*LOOP_COLUMNS, title="control loop")
    table.add_row(
        f"{loop['cycles']:.0f}",
        f"{loop['missed_cycles']:.0f}",
        f"{loop['unmeasured_cycles']:.0f}",
        f"{loop['latest_wake_up_ms']:.2f} ms",
        f"{loop['longest_cycle_ms']:.2f} ms",
        f"{cpu['idle']:.1f} %",
        f"{cpu['moving']:.1f} %",
    )
    return table


def _cells(run: JobRun, joints: Sequence[str]) -> tuple[str | Text, ...]:
    place = Text(run.bin or "none", "green" if run.success else "red")
    error = run.between_cycles
    cells = (run.grade, place, f"{run.duration_s:.2f} s")
    if not error.largest_rad:
        return (*cells, *("?" for _ in range(6)))
    i = error.fastest
    worst_joint = (max(error.largest_rad), max(error.rms_moving_rad), max(error.at_rest_rad))
    fastest_joint = (error.largest_rad[i], error.rms_moving_rad[i])
    return (*cells, *_texts(worst_joint), joints[i], *_texts(fastest_joint))


def _texts(numbers: Iterable[float]) -> list[str]:
    return [f"{number:.4f}" for number in numbers]


def _content(report: DemoReport) -> dict[str, Any]:
    runs = report.runs
    return {
        "success": succeeded(report),
        "cubes": {"in_their_bins": sum(run.success for run in runs), "of": len(runs)},
        "runs": [run_content(run, report.joints) for run in runs],
        "loop": {**report.loop, "cpu_percent_of_a_core": report.cpu_percent},
        "following_error": {
            "of": f"{', '.join(report.joints)}: largest error of all runs, at the cycles and every 5 ms between them",
            **worst(run.between_cycles for run in runs).as_dict(report.joints),
        },
        "without": {what: run_content(run, report.joints) for what, run in report.comparisons.items()},
    }


def run_content(run: JobRun, joints: Sequence[str]) -> dict[str, Any]:
    return {
        "grade": run.grade,
        "success": run.success,
        "bin": run.bin,
        "duration_s": round(run.duration_s, 3),
        "message": run.message,
        "contacts": list(run.contacts),
        "following_error_at_the_cycles": run.at_cycles.as_dict(joints),
        "following_error_between_them": run.between_cycles.as_dict(joints),
    }
