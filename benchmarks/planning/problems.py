"""Public planning problems for a UR5: MotionBenchMaker scenes and requests, and a fine-grained check of plans with
MuJoCo."""

import bz2
import io
import itertools
import re
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import yaml

from hal.types import FloatArray, JointLimits
from planning.arm_model import Pair, pair
from planning.scene import Box, Cylinder, Pose, Scene, SceneObject, Shape, Sphere

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
"""Distance between the poses of the fine-grained check, in rad: a tenth of a planner's usual step."""
SEEN: Final = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco>'


@dataclass(frozen=True, slots=True)
class PlanningProblem:
    """One problem: an arm in a scene, with its start and its goal (6,)."""

    name: str
    scene: Scene
    start: FloatArray
    goal: FloatArray


def read_problems(archive: Path, allowed: frozenset[Pair], most: int) -> Iterator[PlanningProblem]:
    """Yield about ``most`` problems of an archive, drawn evenly from all sets and sorted by name."""
    unpacked = io.BytesIO(bz2.decompress(archive.read_bytes()))  # bz2 cannot seek backward without starting again
    with tarfile.open(fileobj=unpacked) as files:
        names = sorted(name for name in files.getnames() if re.search(r"request\d+\.yaml$", name))
        for name in names[:: max(1, len(names) // most)]:
            request, scene = (_yaml(files, place) for place in (name, name.replace("request", "scene")))
            state = request["start_state"]["joint_state"]
            start = dict(zip(state["name"], state["position"], strict=True))
            goals = request["goal_constraints"][0]["joint_constraints"]
            goal = {constraint["joint_name"]: constraint["position"] for constraint in goals}
            yield PlanningProblem(
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
            (_shape(primitive), _pose(pose))
            for primitive, pose in zip(item["primitives"], item["primitive_poses"], strict=True)
        )
        scene = scene.with_object(SceneObject(item["id"], shapes, _pose(item["pose"]) if "pose" in item else Pose()))
    return scene


def _pose(data: Any) -> Pose:
    return Pose.from_quaternion(data["position"], data["orientation"])


def _shape(primitive: Any) -> Shape:
    sizes = [float(value) for value in primitive["dimensions"]]
    if primitive["type"] == "box":
        return Box(*sizes)
    return Cylinder(*sizes) if primitive["type"] == "cylinder" else Sphere(*sizes)


def plain(urdf: str) -> str:
    """Return the URDF without visual shapes, with fixed links kept as separate links."""
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
    """Return whether a contact is between two links that must not touch and can move relative to each other."""
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
