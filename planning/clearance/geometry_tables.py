"""Convert the geoms of an arm and the objects of a scene into arrays for compiled code."""

import math
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np

from hal.types import FloatArray
from planning.arm_model import ArmModel
from planning.clearance import shapes
from planning.planning_errors import PlanningError
from planning.scene import Box, Cone, Cylinder, Mesh, Pose, Scene, SceneObject, Shape, Sphere

WORLD: Final = -1
"""Frame of geoms that do not move."""
ORDER: Final = 40
"""Number of vertices above which the vertices inside a convex hull are removed."""


class Geom(NamedTuple):
    """One convex shape in the frame of a link or of the world."""

    kind: int
    size: FloatArray
    """Size (3,). planning/clearance/shapes.py defines its meaning for each kind."""
    margin_m: float
    frame: int
    """Index of the link, or ``WORLD``."""
    pose: Pose
    vertices_m: FloatArray
    """Vertices (v, 3) of a hull, or empty for other kinds."""

    @property
    def radius_m(self) -> float:
        """Radius of the sphere around the geom's origin that contains the geom, in m."""
        x, y, z = self.size
        if self.kind == shapes.PLANE:
            return math.inf
        if self.kind == shapes.HULL:
            return float(np.linalg.norm(self.vertices_m, axis=1).max())
        if self.kind == shapes.BOX:
            return math.sqrt(x * x + y * y + z * z)
        if self.kind == shapes.ELLIPSOID:
            return float(max(x, y, z))
        return self.margin_m + math.hypot(x, z)

    @property
    def swing_m(self) -> float:
        """Distance from the origin to the farthest point that a rotation moves, in m, with 0 for a sphere."""
        return 0.0 if self.kind == shapes.POINT else self.radius_m


class GeomGroup(NamedTuple):
    """Geoms that move together and are checked together: the geoms of a link, or one shape of an object."""

    name: str
    geoms: tuple[Geom, ...]
    touch_links: frozenset[str]
    """Links that the unit may touch if the unit is a shape of an attached object."""

    @property
    def frame(self) -> int:
        """Index of the link with which the unit moves, or ``WORLD``."""
        return self.geoms[0].frame

    def swing_m(self, center: FloatArray) -> float:
        """Return the distance from a center (3,) to the farthest point that a rotation about it moves, in m."""
        return max(float(np.linalg.norm(geom.pose.position_m - center)) + geom.swing_m for geom in self.geoms)

    def sphere(self) -> tuple[FloatArray, float]:
        """Return the center (3,) in the unit's frame and the radius of a sphere that encloses all geoms, in m."""
        centers = np.array([geom.pose.position_m for geom in self.geoms])
        radii = np.array([geom.radius_m for geom in self.geoms])
        if not np.all(np.isfinite(radii)):
            return centers[0], math.inf
        center = ((centers - radii[:, None]).min(axis=0) + (centers + radii[:, None]).max(axis=0)) / 2.0
        return center, float((np.linalg.norm(centers - center, axis=1) + radii).max())


NO_VERTICES: Final = np.zeros((0, 3))


def _plain(kind: int, size: tuple[float, float, float], margin_m: float = 0.0) -> tuple[int, FloatArray, float]:
    return kind, np.array(size, dtype=float), margin_m


_FROM_MUJOCO: Final[dict[int, Callable[[FloatArray], tuple[int, FloatArray, float]]]] = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): lambda _: _plain(shapes.PLANE, (0.0, 0.0, 0.0)),
    int(mujoco.mjtGeom.mjGEOM_SPHERE): lambda size: _plain(shapes.POINT, (0.0, 0.0, 0.0), size[0]),
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): lambda size: _plain(shapes.SEGMENT, (0.0, 0.0, size[1]), size[0]),
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): lambda size: _plain(shapes.ELLIPSOID, (size[0], size[1], size[2])),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): lambda size: _plain(shapes.CYLINDER, (size[0], size[0], size[1])),
    int(mujoco.mjtGeom.mjGEOM_BOX): lambda size: _plain(shapes.BOX, (size[0], size[1], size[2])),
}


def arm_units(arm: ArmModel) -> Iterator[GeomGroup]:
    """Yield the links that have geoms."""
    for frame, (link, geoms) in enumerate(arm.link_geoms().items()):
        if geoms:
            yield GeomGroup(link, tuple(_from_model(arm.model, geom, frame) for geom in geoms), frozenset())


def world_units(arm: ArmModel, scene: Scene) -> Iterator[GeomGroup]:
    """Yield the shapes of the world objects, starting with those in the arm's scene file, followed by those in the
    planning scene."""
    gone = scene.removed | set(scene.objects) | set(scene.attached)
    start = mujoco.MjData(arm.model)
    mujoco.mj_kinematics(arm.model, start)
    for name, geoms in arm.world_geoms().items():
        for geom in geoms if name not in gone else ():
            pose = Pose(np.array(start.geom_xpos[geom]), np.array(start.geom_xmat[geom]).reshape(3, 3))
            yield GeomGroup(name, (_from_model(arm.model, geom, WORLD)._replace(pose=pose),), frozenset())
    for item in scene.objects.values():
        yield from _object_units(item, WORLD, frozenset())


def attached_units(arm: ArmModel, scene: Scene) -> Iterator[GeomGroup]:
    """Yield the shapes of the attached objects. Raises PlanningError if a link is not part of the arm."""
    for held in scene.attached.values():
        arm.body(held.link)
        yield from _object_units(held.item, arm.links.index(held.link), held.touch_links | {held.link})


def _object_units(item: SceneObject, frame: int, touch_links: frozenset[str]) -> Iterator[GeomGroup]:
    for shape, pose in item.shapes:
        yield GeomGroup(item.name, (_from_shape(shape, frame, item.pose @ pose),), touch_links)


def _from_model(model: Any, geom: int, frame: int) -> Geom:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
    pose, kind = Pose(np.array(model.geom_pos[geom]), matrix.reshape(3, 3)), int(model.geom_type[geom])
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        mesh = int(model.geom_dataid[geom])
        start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return _hull(np.array(model.mesh_vert[start : start + count], dtype=float), frame, pose)
    if kind not in _FROM_MUJOCO:
        name = model.geom(geom).name or f"number {geom}"
        raise PlanningError(
            "INVALID_ROBOT_STATE", f"geom {name} is a height field or an SDF: replace it with boxes or meshes"
        )
    shape, size, margin_m = _FROM_MUJOCO[kind](model.geom_size[geom])
    return Geom(shape, size, margin_m, frame, pose, NO_VERTICES)


def _from_shape(shape: Shape, frame: int, pose: Pose) -> Geom:
    if isinstance(shape, Mesh):
        return _hull(np.asarray(shape.vertices_m, dtype=float), frame, pose)
    if isinstance(shape, Box):
        kind, size, margin_m = _plain(shapes.BOX, (shape.x_m / 2.0, shape.y_m / 2.0, shape.z_m / 2.0))
    elif isinstance(shape, Sphere):
        kind, size, margin_m = _plain(shapes.POINT, (0.0, 0.0, 0.0), shape.radius_m)
    elif isinstance(shape, Cylinder):
        kind, size, margin_m = _plain(shapes.CYLINDER, (shape.radius_m, shape.radius_m, shape.height_m / 2.0))
    else:
        assert isinstance(shape, Cone)
        kind, size, margin_m = _plain(shapes.CONE, (shape.radius_m, shape.radius_m, shape.height_m / 2.0))
    return Geom(kind, size, margin_m, frame, pose, NO_VERTICES)


def _hull(vertices_m: FloatArray, frame: int, pose: Pose) -> Geom:
    """Return the convex hull of the vertices (v, 3).

    The origin of the hull is the center of the box around the vertices.
    """
    kept = _hull_vertices(vertices_m) if len(vertices_m) > ORDER else vertices_m
    center = (kept.min(axis=0) + kept.max(axis=0)) / 2.0
    centered = np.ascontiguousarray(kept - center)
    return Geom(shapes.HULL, np.abs(centered).max(axis=0), 0.0, frame, pose @ Pose(center), centered)


def _hull_vertices(vertices_m: FloatArray) -> FloatArray:
    """Return the vertices (v, 3) on the convex hull, as computed by MuJoCo."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="hull", uservert=vertices_m.ravel(), maxhullvert=-1)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull")
    try:
        model = spec.compile()
    except ValueError:
        return vertices_m  # MuJoCo does not compute a hull for this mesh. The full set of vertices has the same hull.
    graph = int(model.mesh_graphadr[0])
    if graph < 0 or int(model.mesh_vertnum[0]) != len(vertices_m):
        return vertices_m
    count = int(model.mesh_graph[graph])
    found = model.mesh_graph[graph + 2 + count : graph + 2 + 2 * count]
    kept: FloatArray = vertices_m[np.unique(found)]
    return kept
