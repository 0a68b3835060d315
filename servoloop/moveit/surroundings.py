"""Convert the objects of an arm's scene to collision objects for MoveIt, with clearance at the arm's working poses."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from hal.hal_errors import ArmFileError
from hal.types import FloatArray
from servoloop.motion_planning.collision_matrix import LinkModel, arm_links, arm_roots
from sim_backend.scene.scene_file import scene_model, scene_spec

ROOM_M: Final = 0.005
"""Clearance between the padded arm and the objects on which it stands, rests or works, in m."""
REST_MARGIN_M: Final = 0.03
"""Maximum distance between the actual and the computed rest pose of an arm, in m."""
REACH_M: Final = 0.7
"""Half the side length of the table, in m."""
TABLE_M: Final = 0.04
"""Thickness of the table, in m."""
BOX, SPHERE, CYLINDER = 1, 2, 3
"""Types of shape_msgs/SolidPrimitive."""

Numbers = tuple[float, ...]
Pose = Mapping[str, float]
"""Joint positions in rad or m, keyed by joint name."""


@dataclass(frozen=True, slots=True)
class CollisionShape:
    """Primitive shape of an object with its center and orientation. Dimensions are as in shape_msgs/SolidPrimitive."""

    kind: int
    dimensions: Numbers
    position: Numbers
    quaternion_xyzw: Numbers = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Pit:
    """Rectangle in which the table surface is lowered, in m."""

    x_from: float
    x_to: float
    y_from: float
    y_to: float
    depth: float

    def meets(self, other: "Pit") -> bool:
        """Return whether two pits overlap."""
        along = self.x_from < other.x_to and other.x_from < self.x_to
        return along and self.y_from < other.y_to and other.y_from < self.y_to

    def joined(self, other: "Pit") -> "Pit":
        """Return the smallest pit that contains both pits."""
        x_from, y_from = min(self.x_from, other.x_from), min(self.y_from, other.y_from)
        x_to, y_to = max(self.x_to, other.x_to), max(self.y_to, other.y_to)
        return Pit(x_from, x_to, y_from, y_to, max(self.depth, other.depth))


Objects = dict[str, list[CollisionShape]]


def surroundings(scene: Path, padding_m: float, lying: Sequence[Pose]) -> Objects:
    """Return the fixed objects of a scene, keyed by name.

    The table has pits below the foot, and where the padded arm would touch it in the rest poses ``lying``. The stand at
    which the arm works is lowered by the padding plus ROOM_M. Raises ArmFileError.
    """
    model = scene_model(scene)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bases = {model.body(root.name).id for root in arm_roots(scene_spec(scene), scene)}
    around = [geom for geom in range(model.ngeom) if _stands(model, geom, bases)]
    found: Objects = {}
    for geom in around:
        body, name = model.body(model.geom_bodyid[geom]).name, model.geom(geom).name
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            level = _level(data, geom, name)
            found["table"] = _table(level, _pits(scene, level, padding_m, lying))
        elif shape := _shape(model, data, geom, padding_m + ROOM_M if name.endswith("stand") else 0.0):
            found.setdefault(name if body == "world" else body, []).append(shape)
    return found


def _stands(model: Any, geom: int, bases: Collection[int]) -> bool:
    """Return whether a geometry is fixed, can collide and is not part of the arm with these bases."""
    fixed = model.body_weldid[model.geom_bodyid[geom]] == 0
    return bool(fixed and int(model.body_rootid[model.geom_bodyid[geom]]) not in bases) and bool(
        model.geom_contype[geom] or model.geom_conaffinity[geom]
    )


def _level(data: Any, geom: int, name: str) -> float:
    if abs(data.geom_xmat[geom][8] - 1.0) > 1e-6:
        raise ArmFileError(f"the plane {name} of the scene is tilted: make the plane level")
    return float(data.geom_xpos[geom][2])


def _shape(model: Any, data: Any, geom: int, lower_m: float) -> CollisionShape | None:
    """Return a geometry as a primitive with its top lowered by ``lower_m``, or None if nothing remains."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    middle, turn = data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3)
    primitive, dimensions = BOX, 2.0 * size
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        primitive, dimensions = SPHERE, size[:1]
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        primitive, dimensions = CYLINDER, np.array([2.0 * size[1], size[0]])
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        primitive, dimensions = CYLINDER, np.array([2.0 * (size[0] + size[1]), size[0]])
    elif kind != mujoco.mjtGeom.mjGEOM_BOX:  # A mesh or an ellipsoid is replaced by its bounding box.
        middle, dimensions = middle + turn @ model.geom_aabb[geom][:3], 2.0 * model.geom_aabb[geom][3:]
    if lower_m and primitive == BOX and turn[2, 2] > 1.0 - 1e-6:
        dimensions[2] -= lower_m
        middle[2] -= lower_m / 2
        if dimensions[2] <= 0.0:
            return None
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, turn.ravel())
    return CollisionShape(primitive, _rounded(dimensions), _rounded(middle), _rounded(np.roll(quaternion, -1)))


def _rounded(values: FloatArray) -> Numbers:
    return tuple(round(float(value), 6) + 0.0 for value in values)


def _pits(scene: Path, level: float, padding_m: float, lying: Sequence[Pose]) -> list[Pit]:
    """Return the pits in the table below the foot of the arm and at its rest poses."""
    arm = LinkModel(scene)
    feet, moved = _feet_and_moved(arm)
    arm.place(arm.pose({}))
    below = [_pit(arm, [foot], level, padding_m, ROOM_M) for foot in feet]
    pits: list[Pit] = []
    for positions in lying:
        arm.place(arm.pose(dict(positions)))
        for bodies in moved:
            pit = _pit(arm, bodies, level, padding_m, REST_MARGIN_M)
            for other in [other for other in pits if pit is not None and pit.meets(other)]:
                pits.remove(other)
                pit = pit.joined(other) if pit else other
            pits += [pit] if pit else []
    return [*filter(None, below), *pits]


def _feet_and_moved(arm: LinkModel) -> tuple[list[int], list[list[int]]]:
    """Return the fixed bodies of all arms, and the moving bodies of each arm."""
    model = arm.model
    links = [body for body in range(1, model.nbody) if model.body(body).name in arm.links]
    feet = [body for body in links if model.body_weldid[body] == 0]
    moved: dict[int, list[int]] = {}
    for body in links:
        if body not in feet:
            first = body
            while model.body_parentid[first] not in feet:
                first = int(model.body_parentid[first])
            moved.setdefault(first, []).append(body)
    return feet, [*moved.values()]


def _pit(arm: LinkModel, bodies: Sequence[int], level: float, padding_m: float, margin_m: float) -> Pit | None:
    """Return the pit that these bodies need, including a margin, or None if they are above the table."""
    found = []
    for geom in range(arm.model.ngeom):
        if arm.model.geom_bodyid[geom] in bodies and arm.model.geom_contype[geom]:
            low, high = _extent(arm, geom, padding_m)
            if low[2] < level + ROOM_M:
                found.append((*(low[:2] - margin_m), *(high[:2] + margin_m), level - low[2] + ROOM_M))
    if not found:
        return None
    x_from, y_from, x_to, y_to, depth = np.array(found).T.tolist()
    return Pit(*(round(edge, 3) for edge in (min(x_from), max(x_to), min(y_from), max(y_to), max(depth))))


def _extent(arm: LinkModel, geom: int, padding_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the minimum and maximum x, y and z of a padded geometry."""
    turn = arm.data.geom_xmat[geom].reshape(3, 3)
    middle = arm.data.geom_xpos[geom] + turn @ arm.model.geom_aabb[geom][:3]
    half = np.abs(turn) @ (arm.model.geom_aabb[geom][3:] + padding_m)
    return middle - half, middle + half


def _table(level: float, pits: Sequence[Pit]) -> list[CollisionShape]:
    """Return boxes that form the table, whose surface is lowered at the pits. Boxes of the same height that are
    adjacent along x are merged."""
    xs = _edges(edge for pit in pits for edge in (pit.x_from, pit.x_to))
    ys = _edges(edge for pit in pits for edge in (pit.y_from, pit.y_to))
    bottom = level - max([TABLE_M, *(pit.depth + ROOM_M for pit in pits)])
    boxes: list[CollisionShape] = []
    for y_from, y_to in pairwise(ys):
        runs: list[tuple[float, float, float]] = []
        for x_from, x_to in pairwise(xs):
            begin, depth = x_from, _depth((x_from + x_to) / 2, (y_from + y_to) / 2, pits)
            if runs and runs[-1][2] == depth:
                begin = runs.pop()[0]
            runs.append((begin, x_to, depth))
        for x_from, x_to, depth in runs:
            low, high = np.array([x_from, y_from, bottom]), np.array([x_to, y_to, level - depth])
            boxes.append(CollisionShape(BOX, _rounded(high - low), _rounded((low + high) / 2)))
    return boxes


def _edges(edges: Iterable[float]) -> list[float]:
    return sorted({-REACH_M, REACH_M, *(edge for edge in edges if abs(edge) < REACH_M)})


def _depth(x: float, y: float, pits: Sequence[Pit]) -> float:
    return max((pit.depth for pit in pits if pit.x_from < x < pit.x_to and pit.y_from < y < pit.y_to), default=0.0)


def base_link(scene: Path) -> str:
    """Return the name of the body on which the arm of a scene stands. Raises ArmFileError."""
    return str(arm_roots(scene_spec(scene), scene)[0].name)


def spec_with(scene: Path, objects: Objects, padding_m: float) -> tuple[Any, list[str]]:
    """Return the scene with the objects and with the arm padded as in MoveIt, and the names of the added geometries.

    Padding makes boxes, cylinders and capsules longer at each end and thicker on all sides.
    """
    spec = scene_spec(scene)
    padded = {
        mujoco.mjtGeom.mjGEOM_BOX: 3,
        mujoco.mjtGeom.mjGEOM_CYLINDER: 2,
        mujoco.mjtGeom.mjGEOM_CAPSULE: 1,
        mujoco.mjtGeom.mjGEOM_SPHERE: 1,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID: 3,
    }
    links = {link.name for link in arm_links(arm_roots(spec, scene))}
    for geom in spec.geoms:
        if geom.parent.name in links and (geom.contype or geom.conaffinity):
            used = padded.get(geom.type, 0)
            geom.size = [size + padding_m * (i < used) for i, size in enumerate(geom.size)]
    kinds = {
        BOX: mujoco.mjtGeom.mjGEOM_BOX,
        SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE,
        CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    }
    names = []
    for name, shapes in objects.items():
        for number, shape in enumerate(shapes):
            names.append(f"{name} {number}")
            size = [value / 2 for value in shape.dimensions]
            if shape.kind != BOX:
                height, radius = (0.0, shape.dimensions[0]) if shape.kind == SPHERE else shape.dimensions
                size = [radius, height / 2, 0.0]
            x, y, z, w = shape.quaternion_xyzw
            spec.worldbody.add_geom(
                name=names[-1], type=kinds[shape.kind], pos=shape.position, quat=[w, x, y, z], size=size
            )
    return spec, names
