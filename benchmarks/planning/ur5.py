"""Plan the public problems of a UR5 and collect the figures."""

import time
from dataclasses import dataclass, field

import numpy as np
from rich.table import Table

from benchmarks.planning.problems import Problem, touches
from planning.arm_model import ArmModel
from planning.collision import Collisions
from planning.errors import PlanningError
from planning.paths.planner import plan_path
from planning.paths.request import PathRequest
from planning.paths.smoothing import path_length
from planning.paths.timing import timed


@dataclass(slots=True)
class Results:
    """Figures of all valid problems."""

    valid: int = 0
    times_s: list[float] = field(default_factory=list)
    lengths_rad: list[float] = field(default_factory=list)
    timing_s: list[float] = field(default_factory=list)
    durations_s: list[float] = field(default_factory=list)
    touching: list[str] = field(default_factory=list)
    touching_timed: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


def run(problem: Problem, arm: ArmModel, urdf: str, results: Results, settings: tuple[float, int]) -> None:
    """Plan one problem and add its figures. ``settings`` are the time limit in s and the number of searches."""
    limit_s, searches = settings
    begun_s = time.perf_counter()
    collisions = Collisions(arm, problem.scene)
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
        return
    results.valid += 1
    results.lengths_rad.append(path_length(plan.points))
    results.durations_s.append(motion.duration_s)
    for path, touching in ((plan.points, results.touching), (motion.positions, results.touching_timed)):
        if touches(urdf, problem.scene, arm.adjacent(), path):
            touching.append(problem.name)


def table_of(results: Results, tried: int) -> Table:
    """Return a table of the figures."""
    if not results.times_s:
        raise SystemExit(f"none of the {results.valid} valid problems was solved: {' '.join(results.failed)}")
    times_ms, lengths_rad = np.array(results.times_s) * 1e3, np.array(results.lengths_rad)
    table = Table(title=f"{tried} problems, {results.valid} of them valid")
    timed_touching = f"{len(results.touching_timed)} {' '.join(results.touching_timed)}"
    rows = {
        "solved": f"{len(times_ms)} of {results.valid}",
        "solved within 1 s": f"{int((times_ms < 1000).sum())}",
        "build, search and shortcuts, median": f"{np.median(times_ms):.0f} ms",
        "build, search and shortcuts, 95th percentile": f"{np.percentile(times_ms, 95):.0f} ms",
        "path length, median": f"{np.median(lengths_rad):.2f} rad",
        "plans that touch on the fine check": f"{len(results.touching)} {' '.join(results.touching)}",
        "time parameterization, median": f"{np.median(results.timing_s) * 1e3:.0f} ms",
        "duration of the motion, median": f"{np.median(results.durations_s):.1f} s",
        "trajectories that touch on the fine check": timed_touching,
        "not solved": " ".join(results.failed) or "none",
    }
    table.add_column("figure")
    table.add_column("value")
    for name, value in rows.items():
        table.add_row(name, value)
    return table
