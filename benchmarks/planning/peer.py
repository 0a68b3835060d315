"""Run roboplan on the same problems, in its own interpreter.

The task is a JSON document with the URDF, the SRDF, the names of the joints, the pairs of links that may touch, the
links that never move, the time limit in s and the problems. A problem has the start, the goal and the shapes, each as
kind, sizes and transform. The answer has, for each problem, the path, the time of the search and the total time in s,
or null.
"""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planning.problems import JOINTS, Problem, touches
from benchmarks.planning.ur5 import Results
from planning.arm_model import ArmModel, Pair
from planning.paths.smoothing import path_length
from planning.scene import Box, Cylinder, Pose, Shape, Sphere

SCRIPT = Path(__file__).with_name("roboplan_peer.py")


def run_peer(
    python: Path, problems: Sequence[Problem], arm: ArmModel, models: tuple[str, str], limit_s: float
) -> Results:
    """Plan problems with roboplan.

    Args:
        python: Interpreter that has roboplan.
        problems: Valid problems.
        arm: The arm.
        models: Texts of the URDF and the SRDF.
        limit_s: Time limit of each problem, in s.
    """
    urdf, srdf = models
    task = {
        "urdf": urdf,
        "srdf": srdf,
        "joints": JOINTS,
        "allowed": sorted(_allowed(problems[0], arm)),
        "fixed": [link for link, body in zip(arm.links, arm.bodies, strict=True) if not arm.model.body_weldid[body]],
        "limit_s": limit_s,
        "problems": [_problem(problem) for problem in problems],
    }
    run = subprocess.run([python, SCRIPT], input=json.dumps(task), capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"roboplan ends with {run.returncode}: {run.stderr.strip()[-2000:]}")
    results = Results(valid=len(problems))
    for problem, found in zip(problems, json.loads(run.stdout), strict=True):
        if found is None:
            results.failed.append(problem.name)
            continue
        path = np.array(found["path"])
        results.plan_s.append(found["plan_s"])
        results.times_s.append(found["total_s"])
        results.lengths_rad.append(path_length(path))
        if touches(urdf, problem.scene, arm.adjacent(), path):
            results.touching.append(problem.name)
    return results


def _allowed(problem: Problem, arm: ArmModel) -> frozenset[Pair]:
    """Return the pairs that may touch, including links welded to each other, which MuJoCo never checks."""
    welds = dict(zip(arm.links, (int(arm.model.body_weldid[body]) for body in arm.bodies), strict=True))
    welded = {(one, other) for one in welds for other in welds if one < other and welds[one] == welds[other]}
    known = {pair for pair in problem.scene.allowed if set(pair) <= set(arm.links)}
    return frozenset(known | arm.adjacent() | welded)


def _problem(problem: Problem) -> dict[str, Any]:
    shapes = [
        (*_shape(shape), _transform(item.pose @ pose).tolist())
        for item in problem.scene.objects.values()
        for shape, pose in item.shapes
    ]
    return {"start": problem.start.tolist(), "goal": problem.goal.tolist(), "shapes": shapes}


def _shape(shape: Shape) -> tuple[str, list[float]]:
    if isinstance(shape, Box):
        return "Box", [shape.x_m, shape.y_m, shape.z_m]
    if isinstance(shape, Cylinder):
        return "Cylinder", [shape.radius_m, shape.height_m]
    assert isinstance(shape, Sphere)
    return "Sphere", [shape.radius_m]


def _transform(pose: Pose) -> np.ndarray[Any, np.dtype[np.float64]]:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = pose.matrix, pose.position_m
    return found
