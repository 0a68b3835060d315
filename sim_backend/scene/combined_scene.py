"""Scene of a robot with several arms, generated from the scenes of its arms.

The names of an arm's elements, cube, stand and bins begin with the arm's prefix. The arms are mounted on one table, on
the body `base_link`. Links of the same arm do not collide, but links of different arms do.
"""

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from hal.hal_errors import ArmFileError
from sim_backend.arm_names import ARMS, arm_prefixes, part_name, prefix_of
from sim_backend.scene.cube_cell import FloatArray
from sim_backend.scene.overview import overview_camera
from sim_backend.scene.picture import CAMERA
from sim_backend.scene.plain_scene import TABLE_RGBA
from sim_backend.scene.scene_file import scene_model, scene_spec
from sim_backend.scene.world import READY, REST

BASE: Final = "base_link"
TABLE: Final = "table"
CAMERA_FROM: Final = np.array([1.0, -0.3, 0.75])
"""Direction from the center of the arms to the camera."""
CAMERA_REACHES: Final = 1.5
"""Camera distance, as a multiple of the robot's size."""
FOVY_DEG: Final = 35.0
OPTIONS: Final = ("timestep", "integrator", "cone", "impratio", "gravity")
"""Physics options, copied from the first scene."""


@dataclass(frozen=True, slots=True)
class PlacedArm:
    """Scene of one arm, and its position in the combined scene."""

    prefix: str
    scene: Path
    position_m: tuple[float, float, float]
    """Position of the scene's origin in the new scene, in meters."""
    yaw_rad: float


def table_height_m(scene: Path) -> float:
    """Return the table height in a scene, or 0 if the scene has no table. Raises ArmFileError."""
    spec = scene_spec(scene)
    table = spec.geom(TABLE)
    return 0.0 if table is None else float(table.pos[2])


def combined_scene(name: str, arms: Sequence[PlacedArm], table_m: float) -> str:
    """Return the MJCF of a scene with several arms.

    Args:
        name: Scene name.
        arms: The arms with their scenes.
        table_m: Table height, in meters.

    Raises:
        ArmFileError: A scene cannot be read, or the scenes are not compatible.
    """
    spec: Any = mujoco.MjSpec()
    spec.modelname = name
    spec.add_text(name=ARMS, data=" ".join(arm.prefix for arm in arms))
    first = scene_spec(arms[0].scene)
    for option in OPTIONS:
        setattr(spec.option, option, getattr(first.option, option))
    base = spec.worldbody.add_body(name=BASE)
    _add_table(spec, table_m)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # The options of the first scene are used.
        for number, arm in enumerate(arms):
            _add_arm(spec, base, arm, number)
        model = spec.compile()
        _finish(spec, model, arms)
        return _text(spec)


def _add_table(spec: Any, table_m: float) -> None:
    table = spec.worldbody.add_geom(name=TABLE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.1])
    table.pos, table.rgba, table.friction[0] = [0.0, 0.0, table_m], TABLE_RGBA, 0.5
    table.contype, table.conaffinity = 0, 1


def _add_arm(spec: Any, base: Any, arm: PlacedArm, number: int) -> None:
    """Add an arm as a child of the base, and the rest of its scene as children of the world."""
    own, rest = _reduced(arm.scene), _reduced(arm.scene)
    place = {"pos": arm.position_m, "quat": [np.cos(0.5 * arm.yaw_rad), 0.0, 0.0, np.sin(0.5 * arm.yaw_rad)]}
    first = _first_body(arm.scene)
    root = own.body(first)
    for geom in root.find_all(mujoco.mjtObj.mjOBJ_GEOM):
        _collide(geom, number)
    base.add_frame(**place).attach_body(root, arm.prefix, "")
    for unwanted in (rest.body(first), rest.geom(TABLE), *(rest.lights if number else ())):
        if unwanted is not None:
            _delete(rest, unwanted)
    spec.attach(rest, frame=spec.worldbody.add_frame(**place), prefix=arm.prefix)


def _first_body(scene: Path) -> str:
    """Return the name of the body to which the arm is attached. Raises ArmFileError."""
    model = scene_model(scene)
    if not model.nu:
        raise ArmFileError(f"{scene}:1: the scene has no actuator: add one with the name of each driven joint")
    joint = model.joint(model.actuator(0).name)
    return str(model.body(model.body_rootid[joint.bodyid[0]]).name)


def _reduced(scene: Path) -> Any:
    """Return a scene without its keyframes and custom fields."""
    spec = scene_spec(scene)
    for element in (*spec.keys, *spec.numerics, *spec.texts):
        _delete(spec, element)
    return spec


def _delete(spec: Any, element: Any) -> None:
    """Delete an element and all elements that refer to it. The oldest supported MuJoCo has no ``MjSpec.delete``."""
    if hasattr(spec, "delete"):
        spec.delete(element)
    elif hasattr(element, "delete"):
        element.delete()
    else:
        spec.detach_body(element)


def _collide(geom: Any, number: int) -> None:
    """Let a geom of an arm collide with the other arms. Each arm has its own collision bit, above the table's bit."""
    if geom.contype or geom.conaffinity:
        own = 1 << (number + 1)
        geom.conaffinity |= own
        geom.contype |= ~(2 * own - 1) & 0x7FFFFFFE


def _finish(spec: Any, model: Any, arms: Sequence[PlacedArm]) -> None:
    """Add the keyframes and the camera."""
    models = [scene_model(arm.scene) for arm in arms]
    for key in (READY, REST):
        if all(_has_key(own, key) for own in models):
            spec.add_key(name=key, qpos=_pose(model, arms, [own.key(key).qpos for own in models], models))
    data: Any = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    low, high = data.xpos[1:].min(axis=0), data.xpos[1:].max(axis=0)
    size = float(np.linalg.norm(high - low))
    view = overview_camera(0.5 * (low + high), CAMERA_FROM, CAMERA_REACHES * size)
    spec.worldbody.add_camera(name=CAMERA, fovy=FOVY_DEG, **view)


def _has_key(model: Any, key: str) -> bool:
    return bool(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, key) >= 0)


def _pose(model: Any, arms: Sequence[PlacedArm], poses: Sequence[FloatArray], models: Sequence[Any]) -> FloatArray:
    """Return MuJoCo's positions with all arms in their poses and each free object at its initial place."""
    qpos: FloatArray = model.qpos0.copy()
    for arm, pose, own in zip(arms, poses, models, strict=True):
        for joint in range(own.njnt):
            if own.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
                place = model.joint(f"{arm.prefix}{own.joint(joint).name}").qposadr[0]
                qpos[place] = pose[own.jnt_qposadr[joint]]
    return qpos


def _text(spec: Any) -> str:
    """Return the XML. The two attachments of each arm have the same default classes, which must not be repeated."""
    root = ElementTree.fromstring(str(spec.to_xml()))
    defaults = root.find("default")
    known: set[str] = set()
    for entry in list(defaults if defaults is not None else ()):
        name = entry.get("class", "")
        if name in known and defaults is not None:
            defaults.remove(entry)
        known.add(name)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def keyframes(xml: str) -> dict[str, dict[str, float]]:
    """Return the arms' joint positions in each keyframe of a scene, keyed by keyframe name."""
    model: Any = mujoco.MjModel.from_xml_string(xml)
    places = {model.joint(joint).name: model.jnt_qposadr[joint] for joint in _arm_joints(model)}
    keys = [model.key(number) for number in range(model.nkey)]
    return {key.name: {joint: float(key.qpos[place]) for joint, place in places.items()} for key in keys}


def contacts_between(xml: str, pose: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """Yield each pair of overlapping geoms of two different arms in a pose, which contains positions keyed by joint
    name.

    Joints without a position are at zero, or at the end of their range that is closest to zero.
    """
    model: Any = mujoco.MjModel.from_xml_string(xml)
    data: Any = mujoco.MjData(model)
    for joint in _arm_joints(model):
        low, high = model.jnt_range[joint]
        at = pose.get(model.joint(joint).name, 0.0)
        data.qpos[model.jnt_qposadr[joint]] = np.clip(at, low, high) if model.jnt_limited[joint] else at
    mujoco.mj_kinematics(model, data)
    prefixes = arm_prefixes(model)
    owned = {prefix: _solid(model, prefix, prefixes) for prefix in prefixes}
    for one, other in combinations(prefixes, 2):
        yield from _overlaps(model, data, owned[one], owned[other])


def _arm_joints(model: Any) -> list[int]:
    return [joint for joint in range(model.njnt) if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE]


def _solid(model: Any, prefix: str, prefixes: Sequence[str]) -> list[int]:
    solid = [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    return [geom for geom in solid if prefix_of(part_name(model, geom), prefixes) == prefix]


def _overlaps(model: Any, data: Any, ones: Sequence[int], others: Sequence[int]) -> Iterator[tuple[str, str]]:
    for one in ones:
        for other in others:
            gap = np.linalg.norm(data.geom_xpos[one] - data.geom_xpos[other])
            if gap > model.geom_rbound[one] + model.geom_rbound[other]:
                continue
            if mujoco.mj_geomDistance(model, data, one, other, 0.01, None) <= 0.0:
                yield part_name(model, one), part_name(model, other)
