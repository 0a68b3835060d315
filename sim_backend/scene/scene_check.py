"""Check that a scene is complete and matches the robot description.

MuJoCo also reads the description, so that two models can be compared: the pose of each body relative to its parent at
random joint positions, and the ranges, masses and couplings.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from hal.hal_errors import ArmFileError
from sim_backend.arm_names import arm_prefixes
from sim_backend.scene.cube_cell import BINS, FloatArray, cell_prefixes
from sim_backend.scene.scene_file import scene_model
from sim_backend.scene.world import READY

NOTHING: Final = 1e-6
"""Mass of a link for which the description does not specify a mass, in kg."""
POSES: Final = 10
SEED: Final = 1
APART_M: Final = 1e-4
APART_RAD: Final = 1e-3
APART_SHARE: Final = 0.01
"""Maximum relative difference of a mass or an inertia."""
NEEDED: Final = {
    "joint": ("cube",),
    "geom": ("cube", "stand", "cube_place"),
    "body": tuple(f"bin_{name}" for name in BINS),
    "site": tuple(f"bin_{name}_inside" for name in BINS),
}
"""Names required by a cell of the pick-and-place job, keyed by type. Each name begins with the arm's prefix, if any."""


def scene_problems(scene: Path, urdf_xml: str, driven: Sequence[str], cell: bool = False) -> list[str]:
    """Return all errors in a scene.

    Args:
        scene: The MuJoCo file.
        urdf_xml: The robot description.
        driven: The joints that have servos.
        cell: Whether the scene must have the cell of the pick-and-place job.

    Returns:
        One sentence per error. If the error is in the file itself, the message begins with the file path.
    """
    try:
        model: Any = scene_model(scene)
    except ArmFileError as error:
        return str(error).splitlines()
    try:
        described = described_model(urdf_xml)
    except ValueError as error:
        return [f"MuJoCo cannot read the URDF: {' '.join(str(error).split())}"]
    return [
        *_missing(model, driven, cell),
        *_joints(model, described),
        *_bodies(model, described),
        *_places(model, described),
    ]


def require_scene(scene: Path, driven: Sequence[str], cell: bool = False) -> None:
    """Check that a world can be built from a scene. ``driven`` contains the joints that have servos.

    A scene that contains any element of the pick-and-place cell, or for which ``cell`` is set, must contain all
    elements of it. Raises ArmFileError with a list of everything that is missing from the scene.
    """
    model: Any = scene_model(scene)
    if missing := [joint for joint in driven if joint not in names(model, "actuator")]:
        raise ArmFileError(
            f"{scene} has no actuator for {', '.join(missing)}: choose the arm that has these joints with --arm"
        )
    if problems := list(_needed(model, cell)):
        raise ArmFileError("\n".join(f"{scene}: {problem}" for problem in problems))


def described_model(urdf_xml: str) -> Any:
    """Return a model of the arm in a robot description, ignoring its shapes, because the shape files may be missing."""
    robot = ElementTree.fromstring(urdf_xml)
    for link in robot.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    # Bodies are not merged, and values are not corrected. Only missing masses are added, so that they do not hide other
    # errors.
    bounds = {"boundmass": str(NOTHING), "boundinertia": str(NOTHING**2)}
    as_it_is = {"fusestatic": "false", "balanceinertia": "false", **bounds}
    ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler", as_it_is)
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(robot, encoding="unicode"))


def names(model: Any, kind: str) -> list[str]:
    """Return the names of all objects of a ``kind`` ("joint", "body" and so on) in a model."""
    count = getattr(model, {"joint": "njnt", "actuator": "nu"}.get(kind, f"n{kind}"))
    return [str(getattr(model, kind)(i).name) for i in range(count)]


def _needed(model: Any, cell: bool) -> Iterator[str]:
    prefixes = arm_prefixes(model) if cell else cell_prefixes(model)
    parts = [(kind, f"{prefix}{name}") for prefix in prefixes for kind, some in NEEDED.items() for name in some]
    needed = [("key", READY), *parts, ("cam", "overview")] if prefixes else []
    for kind, name in needed:
        if name not in names(model, kind):
            what = {"key": "keyframe", "cam": "camera"}.get(kind, kind)
            yield f"the scene has no {what} {name}"


def _missing(model: Any, driven: Sequence[str], cell: bool) -> Iterator[str]:
    yield from _needed(model, cell)
    motors = names(model, "actuator")
    yield from (
        f"the scene has no actuator {joint}: each joint with a servo needs one"
        for joint in driven
        if joint not in motors
    )
    yield from (f"the actuator {motor} has no joint with a servo" for motor in motors if motor not in driven)


def _joints(model: Any, described: Any) -> Iterator[str]:
    """Yield joints that are missing or have different ranges, and couplings that differ from the mimic joints in the
    description."""
    there = names(model, "joint")
    for name in names(described, "joint"):
        if name not in there:
            yield f"the scene has no joint {name}, which the URDF has"
        elif np.abs(model.joint(name).range - described.joint(name).range).max() > APART_RAD:
            here_range, urdf_range = _span(model.joint(name).range), _span(described.joint(name).range)
            yield f"{name} has the range {here_range} in the scene and {urdf_range} in the URDF"
    here, wanted_couplings = _couplings(model), _couplings(described)
    for (follower, leader), wanted in wanted_couplings.items():
        got = here.get((follower, leader))
        if got is None:
            yield f"{follower} does not follow {leader} in the scene: an <equality> of the two joints is missing"
        elif not np.allclose(got, wanted, atol=APART_M):
            offset, multiplier = got
            yield (
                f"{follower} follows {leader} with multiplier {multiplier:g} and offset {offset:g} in the scene, but "
                f"with {wanted[1]:g} and {wanted[0]:g} in the URDF"
            )


def _couplings(model: Any) -> dict[tuple[str, str], tuple[float, float]]:
    """Return the offset and multiplier of each coupling, keyed by the follower and leader joints."""
    rows = [i for i in range(model.neq) if model.eq_type[i] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[i] >= 0]
    return {
        (model.joint(model.eq_obj1id[i]).name, model.joint(model.eq_obj2id[i]).name): tuple(
            model.eq_data[i, :2].tolist()
        )
        for i in rows
    }


def _bodies(model: Any, described: Any) -> Iterator[str]:
    there, root = names(model, "body"), described.body(1).name
    for name in names(described, "body"):
        if name not in there:
            if described.body(name).jntnum[0] or name == root:
                which = "the first link of the URDF" if name == root else "a link of the URDF that moves"
                yield f"the scene has no body {name}, which is {which}"
            continue
        here, wanted = model.body(name), described.body(name)
        if name == root or not wanted.jntnum[0] or wanted.mass[0] <= NOTHING:
            continue  # MuJoCo may have merged a body that is fixed to another body into that body.
        if abs(here.mass[0] - wanted.mass[0]) > APART_SHARE * wanted.mass[0]:
            yield f"{name} weighs {here.mass[0]:g} kg in the scene and {wanted.mass[0]:g} kg in the URDF"
        if np.abs(here.ipos - wanted.ipos).max() > APART_M:
            here_at, urdf_at = _vector(here.ipos), _vector(wanted.ipos)
            yield f"{name} has its center of mass at {here_at} in the scene and at {urdf_at} in the URDF"
        if not np.allclose(sorted(here.inertia), sorted(wanted.inertia), rtol=APART_SHARE):
            here_inertia, urdf_inertia = _vector(here.inertia), _vector(wanted.inertia)
            yield f"{name} has the principal inertias {here_inertia} in the scene and {urdf_inertia} in the URDF"


def _places(model: Any, described: Any) -> Iterator[str]:
    """Yield each moving link whose pose relative to its parent link differs from the description at one of the joint
    positions."""
    common = [name for name in names(described, "joint") if name in names(model, "joint")]
    links = [_link(described, name) for name in common]
    links = [(link, before) for link, before in links if {link, before} <= set(names(model, "body"))]
    off: dict[str, tuple[float, float]] = {}
    random = np.random.default_rng(SEED)
    for _ in range(POSES):
        pose = {name: random.uniform(*described.joint(name).range) for name in common}
        one, other = _posed(model, pose), _posed(described, pose)
        for link, before in links:
            apart = _apart(one, other, link, before)
            off[link] = max(off.get(link, (0.0, 0.0)), apart)
    for link, (meters, radians) in off.items():
        if meters > APART_M or radians > APART_RAD:
            yield f"{link} is up to {meters:.4f} m and {radians:.3f} rad away from its place in the URDF"


def _link(model: Any, joint: str) -> tuple[str, str]:
    """Return the name of the body that a joint moves and the name of that body's parent."""
    body = model.joint(joint).bodyid[0]
    return model.body(body).name, model.body(model.body_parentid[body]).name


def _posed(model: Any, pose: dict[str, float]) -> Any:
    data: Any = mujoco.MjData(model)
    for name, position in pose.items():
        data.joint(name).qpos = position
    mujoco.mj_kinematics(model, data)
    return data


def _apart(one: Any, other: Any, link: str, before: str) -> tuple[float, float]:
    """Return the difference (m, rad) between a link's poses, relative to its parent link, in two models."""
    (place, turn), (other_place, other_turn) = _seen(one, link, before), _seen(other, link, before)
    between = turn.T @ other_turn
    return float(np.linalg.norm(place - other_place)), float(np.arccos(np.clip((np.trace(between) - 1) / 2, -1.0, 1.0)))


def _seen(data: Any, link: str, before: str) -> tuple[FloatArray, FloatArray]:
    here, there = data.body(before), data.body(link)
    frame = here.xmat.reshape(3, 3)
    return frame.T @ (there.xpos - here.xpos), frame.T @ there.xmat.reshape(3, 3)


def _span(limits: Sequence[float]) -> str:
    return f"{limits[0]:g} to {limits[1]:g}"


def _vector(values: Sequence[float]) -> str:
    return " ".join(f"{value:.4g}" for value in values)
