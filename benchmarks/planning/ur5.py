"""Plan the public problems of a UR5 and collect the results."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from rich.table import Table

from benchmarks.planning.problems import PlanningProblem, touches
from planning.arm_model import ArmModel
from planning.collision import Collisions
from planning.paths.planner import plan_path
from planning.paths.request import PathRequest
from planning.paths.search import find_path
from planning.paths.smoothing import path_length
from planning.paths.timing import timed
from planning.planning_errors import PlanningError

SHOWN = 2
"""Number of problem names to list."""


@dataclass(slots=True)
class Results:
    """Results for all valid problems."""

    valid: int = 0
    plan_s: list[float] = field(default_factory=list)
    """Duration of the first search, without shortcuts, in seconds."""
    times_s: list[float] = field(default_factory=list)
    """Duration of all searches and shortcuts, without scene construction, in seconds."""
    lengths_rad: list[float] = field(default_factory=list)
    timing_s: list[float] = field(default_factory=list)
    durations_s: list[float] = field(default_factory=list)
    touching: list[str] = field(default_factory=list)
    """Names of the problems whose plans touch something according to the fine-grained check."""
    touching_timed: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


def run(problem: PlanningProblem, arm: ArmModel, urdf: str, results: Results, settings: tuple[float, int]) -> bool:
    """Plan one problem, add its results and return whether it is valid.

    ``settings`` contains the time limit in s and the number of searches.
    """
    limit_s, searches = settings
    collisions = Collisions(arm, problem.scene)
    begun_s = time.perf_counter()
    request = PathRequest(problem.start, (problem.goal,))
    try:
        plan = plan_path(arm, collisions, request, lambda: begun_s + limit_s - time.perf_counter(), searches)
        results.times_s.append(time.perf_counter() - begun_s)
        motion = timed(plan.points, arm.limits, collisions, plan.margins)
        results.timing_s.append(time.perf_counter() - begun_s - results.times_s[-1])
    except PlanningError as error:
        if error.code in ("TIMED_OUT", "PLANNING_FAILED"):
            results.valid += 1
            results.failed.append(f"{problem.name} ({error.code})")
        return error.code in ("TIMED_OUT", "PLANNING_FAILED")
    results.valid += 1
    results.lengths_rad.append(path_length(plan.points))
    results.durations_s.append(motion.duration_s)
    for path, touching in ((plan.points, results.touching), (motion.positions, results.touching_timed)):
        if touches(urdf, problem.scene, arm.adjacent(), path):
            touching.append(problem.name)
    begun_s = time.perf_counter()
    find_path(arm, collisions, request, lambda: limit_s)
    results.plan_s.append(time.perf_counter() - begun_s)
    return True


def table_of(columns: Mapping[str, Results]) -> Table:
    """Return a table with the results of one or more planners, keyed by planner name."""
    table = Table("figure", *columns)
    rows = [_rows(results) for results in columns.values()]
    for name in rows[0]:
        table.add_row(name, *(row.get(name, "") for row in rows))
    return table


def _rows(results: Results) -> dict[str, str]:
    if not results.times_s:
        raise SystemExit(f"none of the {results.valid} valid problems was solved: {' '.join(results.failed)}")
    times_ms, lengths_rad = np.array(results.times_s) * 1e3, np.array(results.lengths_rad)
    plan_ms = np.array(results.plan_s) * 1e3
    rows = {
        "solved": f"{len(times_ms)} of {results.valid}",
        "solved within 1 s": f"{int((times_ms < 1000).sum())}",
        "first search, median": f"{np.median(plan_ms):.0f} ms",
        "first search, 95th percentile": f"{np.percentile(plan_ms, 95):.0f} ms",
        "with shortcuts, median": f"{np.median(times_ms):.0f} ms",
        "with shortcuts, 95th percentile": f"{np.percentile(times_ms, 95):.0f} ms",
        "path length, median": f"{np.median(lengths_rad):.2f} rad",
        "plans with contact in the fine check": _counted(results.touching),
        "not solved": _counted(results.failed),
    }
    if results.timing_s:
        rows |= {
            "time parameterization, median": f"{np.median(results.timing_s) * 1e3:.0f} ms",
            "duration of the motion, median": f"{np.median(results.durations_s):.1f} s",
            "trajectories with contact in the fine check": _counted(results.touching_timed),
        }
    return rows


def _counted(names: Sequence[str]) -> str:
    """Return a string with the number of problems and the first few names."""
    return f"{len(names)} {', '.join(names[:SHOWN])}{', ...' if len(names) > SHOWN else ''}"
