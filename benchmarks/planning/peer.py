"""Run roboplan on the same problems, in its own interpreter.

The first line of the input is a JSON document. It contains the URDF, the SRDF, the joint names, the pairs of links that
may touch, the links that never move, and the time limit in s. Each further line is a problem: the start, the goal and
the shapes, each of which has a type, sizes and a transform. Each problem is answered with one line: the path, the
search time and the total time in s, or null if there is no path. Problems alternate with those of servoloop, so that
other load on the machine slows down both planners.
"""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planning.problems import JOINTS, PlanningProblem, touches
from benchmarks.planning.ur5 import Results
from planning.arm_model import ArmModel, Pair
from planning.paths.smoothing import path_length
from planning.scene import Box, Cylinder, Pose, Shape, Sphere

SCRIPT = Path(__file__).with_name("roboplan_peer.py")


class Peer:
    """A running roboplan process.

    Args:
        python: Interpreter in which roboplan is installed.
        arm: The arm.
        models: Contents of the URDF and the SRDF.
        allowed: Pairs of links that may touch.
        limit_s: Time limit of each problem, in s.
    """

    def __init__(
        self, python: Path, arm: ArmModel, models: tuple[str, str], allowed: frozenset[Pair], limit_s: float
    ) -> None:
        self.results = Results()
        self._arm, self._urdf = arm, models[0]
        self._process = subprocess.Popen([python, SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        task = {
            "urdf": models[0],
            "srdf": models[1],
            "joints": JOINTS,
            "allowed": sorted(_allowed(allowed, arm)),
            "fixed": [
                link for link, body in zip(arm.links, arm.bodies, strict=True) if not arm.model.body_weldid[body]
            ],
            "limit_s": limit_s,
        }
        self._send(task)

    def run(self, problem: PlanningProblem) -> None:
        """Plan one problem and add its results."""
        self._send(_problem(problem))
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"roboplan exited with status {self._process.wait()}")
        self.results.valid += 1
        found = json.loads(line)
        if found is None:
            self.results.failed.append(problem.name)
            return
        path = np.array(found["path"])
        self.results.plan_s.append(found["plan_s"])
        self.results.times_s.append(found["total_s"])
        self.results.lengths_rad.append(path_length(path))
        if touches(self._urdf, problem.scene, self._arm.adjacent(), path):
            self.results.touching.append(problem.name)

    def close(self) -> None:
        """End the process."""
        self._process.communicate(timeout=10.0)

    def _send(self, document: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(document) + "\n")
        self._process.stdin.flush()


def _allowed(allowed: frozenset[Pair], arm: ArmModel) -> frozenset[Pair]:
    """Return the pairs of links that may touch, including links welded together. MuJoCo never checks welded links for
    contact."""
    welds = dict(zip(arm.links, (int(arm.model.body_weldid[body]) for body in arm.bodies), strict=True))
    welded = {(one, other) for one in welds for other in welds if one < other and welds[one] == welds[other]}
    known = {pair for pair in allowed if set(pair) <= set(arm.links)}
    return frozenset(known | arm.adjacent() | welded)


def _problem(problem: PlanningProblem) -> dict[str, Any]:
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
