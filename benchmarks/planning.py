"""Plan public problems of a UR5: ``python -m benchmarks.planning DATA [--problems 30] [--limit 5]``.

DATA is a folder with problems.tar.bz2 (scenes and requests of MotionBenchMaker), ur5_spherized.urdf and ur5.srdf.
A problem is valid if its start and its goal are not in contact. MuJoCo's own collision detection, with ten poses for
each 0.05 rad, counts the plans that touch something.
"""

import argparse
import bz2
import io
import itertools
import re
import tarfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from benchmarks.arguments import in_words, positive
from hal.types import FloatArray, JointLimits
from planning.arm_model import ArmModel, Pair, pair
from planning.collision import Collisions, warm_up
from planning.errors import PlanningError
from planning.paths.planner import SEARCHES, plan_path
from planning.paths.request import PathRequest
from planning.paths.smoothing import path_length
from planning.paths.timing import timed
from planning.scene import Box, Cylinder, Pose, Scene, SceneObject, Shape, Sphere
from planning.srdf_file import read_pairs

JOINTS: Final = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
LIMIT: Final = JointLimits(-3.14159265, 3.14159265, velocity=0.5, acceleration=2.0, jerk=20.0)
FINE_RAD: Final = 0.005
"""Distance of the poses of the fine check, in rad: a tenth of the usual step of a planner."""
SEEN: Final = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco>'


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem: an arm in a scene, its start and its goal (6,)."""

    name: str
    scene: Scene
    start: FloatArray
    goal: FloatArray


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


def main() -> None:
    """Plan the problems and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--problems", type=positive, default=30, help="number of problems, evenly from all sets")
    parser.add_argument("--limit", type=float, default=5.0, help="time for each problem, in seconds")
    parser.add_argument("--searches", type=positive, default=SEARCHES, help="searches for each problem")
    arguments = parser.parse_args()
    with in_words():
        urdf = _plain((arguments.data / "ur5_spherized.urdf").read_text())
        allowed = frozenset(read_pairs(arguments.data / "ur5.srdf"))
        problems = list(read_problems(arguments.data / "problems.tar.bz2", allowed, arguments.problems))
    results = Results()
    arm = ArmModel.from_string(urdf, dict.fromkeys(JOINTS, LIMIT))
    warm_up()
    for problem in problems:
        run(problem, arm, urdf, results, (arguments.limit, arguments.searches))
    show(results, len(problems))


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


def show(results: Results, tried: int) -> None:
    """Print the figures."""
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
    Console().print(table)


def read_problems(archive: Path, allowed: frozenset[Pair], most: int) -> Iterator[Problem]:
    """Yield about ``most`` problems of an archive, evenly from all sets, in the order of their names."""
    unpacked = io.BytesIO(bz2.decompress(archive.read_bytes()))  # bz2 cannot seek back without a new start
    with tarfile.open(fileobj=unpacked) as files:
        names = sorted(name for name in files.getnames() if re.search(r"request\d+\.yaml$", name))
        for name in names[:: max(1, len(names) // most)]:
            request, scene = (_yaml(files, place) for place in (name, name.replace("request", "scene")))
            state = request["start_state"]["joint_state"]
            start = dict(zip(state["name"], state["position"], strict=True))
            goals = request["goal_constraints"][0]["joint_constraints"]
            goal = {constraint["joint_name"]: constraint["position"] for constraint in goals}
            yield Problem(
                "/".join(name.removesuffix(".yaml").split("/")[-2:]),
                _scene(scene, allowed),
                *(np.array([float(where[joint]) for joint in JOINTS]) for where in (start, goal)),
            )


def _yaml(files: tarfile.TarFile, name: str) -> Any:
    file = files.extractfile(name)
    assert file is not None
    return yaml.load(file, Loader=yaml.CSafeLoader)


def _scene(data: Any, allowed: frozenset[Pair]) -> Scene:
    scene = Scene(allowed=allowed)
    for item in data["world"]["collision_objects"]:
        shapes = tuple(
            (_shape(primitive), Pose.from_quaternion(pose["position"], pose["orientation"]))
            for primitive, pose in zip(item["primitives"], item["primitive_poses"], strict=True)
        )
        scene = scene.with_object(SceneObject(item["id"], shapes))
    return scene


def _shape(primitive: Any) -> Shape:
    sizes = [float(value) for value in primitive["dimensions"]]
    if primitive["type"] == "box":
        return Box(*sizes)
    return Cylinder(*sizes) if primitive["type"] == "cylinder" else Sphere(*sizes)


def _plain(urdf: str) -> str:
    """Return a URDF without pictures, whose fixed links stay links of their own."""
    urdf = re.sub(r"<visual>.*?</visual>", "", re.sub(r"<\?xml.*?\?>", "", urdf), flags=re.DOTALL)
    return re.sub(r"(<robot\b[^>]*>)", rf"\1{SEEN}", urdf, count=1)


def touches(urdf: str, scene: Scene, adjacent: frozenset[Pair], path: FloatArray) -> bool:
    """Return whether MuJoCo finds a contact on a path (m, 6) between links that are not adjacent."""
    allowed = scene.allowed | adjacent
    spec = mujoco.MjSpec.from_string(urdf)
    for item in scene.objects.values():
        for shape, pose in item.shapes:
            _add(spec, shape, item.pose @ pose)
    model: Any = spec.compile()
    data: Any = mujoco.MjData(model)
    places = [int(model.joint(name).qposadr[0]) for name in JOINTS]
    for one, other in itertools.pairwise(path):
        count = int(np.ceil(np.linalg.norm(other - one) / FINE_RAD)) + 1
        for part in np.linspace(0.0, 1.0, count):
            data.qpos[places] = one + (other - one) * part
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            if any(_counts(model, geoms, allowed) for geoms in data.contact.geom):
                return True
    return False


def _counts(model: Any, geoms: Any, allowed: frozenset[Pair]) -> bool:
    """Return whether a contact is between links that must not touch, one of which moves relative to the other."""
    bodies = [int(model.geom_bodyid[geom]) for geom in geoms]
    names = [str(model.body(body).name) for body in bodies]
    return int(model.body_weldid[bodies[0]]) != int(model.body_weldid[bodies[1]]) and pair(*names) not in allowed


def _add(spec: Any, shape: Shape, pose: Pose) -> None:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, pose.matrix.ravel())
    if isinstance(shape, Box):
        kind, size = mujoco.mjtGeom.mjGEOM_BOX, [shape.x_m / 2, shape.y_m / 2, shape.z_m / 2]
    elif isinstance(shape, Cylinder):
        kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [shape.radius_m, shape.height_m / 2, 0.0]
    else:
        assert isinstance(shape, Sphere)
        kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, [shape.radius_m, 0.0, 0.0]
    spec.worldbody.add_geom(type=kind, size=size, pos=pose.position_m, quat=quaternion)


if __name__ == "__main__":
    main()
