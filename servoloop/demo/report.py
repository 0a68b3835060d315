"""The demo's report: a table in the terminal and result.json."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from servoloop.demo.demo import Report
from servoloop.demo.following_error import worst
from servoloop.demo.jobs import Run
from servoloop.files import write_file


def write_json(report: Report, path: Path) -> None:
    """Write the report for programs. Raises DriverError."""
    write_file(path, json.dumps(_content(report), indent=2, allow_nan=False) + "\n", keep=False)


def succeeded(report: Report) -> bool:
    """Whether every cube lies in the bin of its grade."""
    return bool(report.runs) and all(run.success for run in report.runs)


def print_table(report: Report, console: Console) -> None:
    """Print the report for people."""
    columns = ("grade", "bin", "time", "largest", "RMS", "at rest", "fastest", "largest", "RMS")
    table = Table(*columns, title="following error, rad")
    for column in (*table.columns[2:6], *table.columns[7:]):
        column.justify = "right"
    for run in report.runs:
        table.add_row(*_cells(run, report.joints))
    table.add_section()
    marks = {what: "*" * count for count, what in enumerate(report.comparisons, 1)}
    for what, run in report.comparisons.items():
        grade, *rest = _cells(run, report.joints)
        table.add_row(f"{grade} {marks[what]}", *rest)
    console.print(table)
    console.print("of the worst joint and of the fastest; RMS while moving, at rest half a second after a motion")
    if marks:
        console.print(", ".join(f"{mark} without {what}" for what, mark in marks.items()))
    console.print()
    console.print(_loop_table(report))
    console.print(f"cubes in their bins: {sum(run.success for run in report.runs)} of {len(report.runs)}")


def _loop_table(report: Report) -> Table:
    loop, cpu = report.loop, report.cpu_percent
    columns = ("cycles", "missed", "unmeasured", "latest wake-up", "longest cycle", "CPU idle", "CPU moving")
    table = Table(*columns, title="control loop")
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


def _cells(run: Run, joints: Sequence[str]) -> tuple[str, ...]:
    place = ("[green]" if run.success else "[red]") + (run.bin or "none") + "[/]"
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


def _content(report: Report) -> dict[str, Any]:
    runs = report.runs
    return {
        "success": succeeded(report),
        "cubes": {"in_their_bins": sum(run.success for run in runs), "of": len(runs)},
        "runs": [_run(run, report.joints) for run in runs],
        "loop": {**report.loop, "cpu_percent_of_a_core": report.cpu_percent},
        "following_error": {
            "of": f"{', '.join(report.joints)}: the worst of all runs, at the cycles and every 5 ms between them",
            **worst(run.between_cycles for run in runs).as_dict(report.joints),
        },
        "without": {what: _run(run, report.joints) for what, run in report.comparisons.items()},
    }


def _run(run: Run, joints: Sequence[str]) -> dict[str, Any]:
    return {
        "grade": run.grade,
        "success": run.success,
        "bin": run.bin,
        "duration_s": round(run.duration_s, 3),
        "message": run.message,
        "following_error_at_the_cycles": run.at_cycles.as_dict(joints),
        "following_error_between_them": run.between_cycles.as_dict(joints),
    }
