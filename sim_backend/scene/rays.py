"""First hits of rays on the geoms of a MuJoCo model, in compiled code. n is the number of rays.

MuJoCo provides the poses of the geoms. MuJoCo's own mj_multiRay is not used, because its culling removes parts of
geoms.
"""

from math import inf, sqrt
from typing import Any, Final

import mujoco
import numpy as np

from sim_backend.compiled import compiled
from sim_backend.scene.ellipsoid_rays import cast_ellipsoid
from sim_backend.scene.mesh_rays import cast_mesh, mesh_parts
from sim_backend.scene.ray_types import FloatArray, GeomView, RayHits

Hits = tuple[Any, FloatArray, FloatArray]
"""Hit of each ray: geom (n,), -1 if there is none; distance (n,), infinite if there is none; normal (n, 3)."""

VISIBLE_GROUPS: Final = (0, 1, 2)
"""Geom groups that are rendered. Geoms in other groups are used only by the simulation."""
PLANE: Final = int(mujoco.mjtGeom.mjGEOM_PLANE)
SPHERE: Final = int(mujoco.mjtGeom.mjGEOM_SPHERE)
ELLIPSOID: Final = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
BOX: Final = int(mujoco.mjtGeom.mjGEOM_BOX)
CYLINDER: Final = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
MESH: Final = int(mujoco.mjtGeom.mjGEOM_MESH)
DRAWN: Final = (PLANE, SPHERE, ELLIPSOID, BOX, CYLINDER, MESH)
WALL: Final = -1
"""Face number of a hit on the curved wall of a cylinder. Other faces are identified by the axis that is normal to
them."""


def visible(model: Any) -> Any:
    """Return the indices of all geoms that are rendered."""
    return np.flatnonzero(np.isin(model.geom_group, VISIBLE_GROUPS) & (model.geom_rgba[:, 3] > 0.0))


def no_hits(count: int) -> Hits:
    """Return an array for the hits of ``count`` rays, without any hits."""
    return np.full(count, -1), np.full(count, np.inf), np.zeros((count, 3))


def cast(model: Any, data: Any, origin: FloatArray, rays: FloatArray, geoms: Any, so_far: Hits | None = None) -> Hits:
    """Return the first hit of each ray on one of ``geoms``, or the hit in ``so_far`` if that hit is nearer.

    Raises ValueError if a geom's shape cannot be drawn.
    """
    geom, nearest, normal = (values.copy() for values in so_far or no_hits(len(rays)))
    hits = RayHits(rays, geom, nearest, normal)
    for i in geoms:
        kind, axes = int(model.geom_type[i]), data.geom_xmat[i].reshape(3, 3)
        if kind not in DRAWN:
            raise ValueError(
                f"images can show planes, spheres, ellipsoids, boxes, cylinders and meshes, but not geom type {kind}"
            )
        away = data.geom_xpos[i] - origin
        # A plane has no bounding sphere, so every ray can hit it.
        outside = float(away @ away) - (1.001 * model.geom_rbound[i]) ** 2
        beside = -inf if kind == PLANE else max(0.0, outside) ** 0.5
        view = GeomView(int(i), axes, away, -away @ axes, beside)
        size = model.geom_size[i]
        if kind == MESH:
            cast_mesh(mesh_parts(model, int(model.geom_dataid[i])), view, hits)
        elif kind in (SPHERE, ELLIPSOID):
            cast_ellipsoid(size if kind == ELLIPSOID else np.full(3, size[0]), view, hits)
        elif kind == CYLINDER:
            _cast_solid(np.array([0.0, 0.0, size[1]]), float(size[0]), view, hits)
        else:
            _cast_solid(size, 0.0, view, hits)
    return geom, nearest, normal


@compiled
def _cast_solid(half: FloatArray, radius: float, view: GeomView, hits: RayHits) -> None:
    """Store each ray's hit on one box, cylinder or plane if it is nearer than the hit stored so far. A
    plane has no bounding sphere."""
    number, axes, away, origin, beside = view
    rays, geom, nearest, normal = hits
    x, y, z = away
    ray = np.empty(3)
    for n in range(len(rays)):
        if rays[n, 0] * x + rays[n, 1] * y + rays[n, 2] * z <= beside:
            continue
        for i in range(3):
            ray[i] = rays[n, 0] * axes[0, i] + rays[n, 1] * axes[1, i] + rays[n, 2] * axes[2, i]
        distance, face = _on_plane(origin, ray) if beside == -inf else _on_solid(half, radius, origin, ray)
        if not 0.0 < distance < nearest[n]:
            continue
        nearest[n], geom[n] = distance, number
        for i in range(3):
            if face == WALL:
                x_wall, y_wall = origin[0] + distance * ray[0], origin[1] + distance * ray[1]
                normal[n, i] = (axes[i, 0] * x_wall + axes[i, 1] * y_wall) / radius
            else:
                normal[n, i] = axes[i, face] if ray[face] < 0.0 else -axes[i, face]


@compiled
def _on_plane(origin: FloatArray, ray: FloatArray) -> tuple[float, int]:
    """Return the distance (infinite if there is no hit) and the face of the hit, in the plane's frame."""
    return (-origin[2] / ray[2] if ray[2] < 0.0 else inf), 2


@compiled
def _on_solid(half: FloatArray, radius: float, origin: FloatArray, ray: FloatArray) -> tuple[float, int]:
    """Return the distance (infinite if there is no hit) and the face of the first hit, in the solid's frame.

    Each solid is convex: an intersection of slabs or, if a ``radius`` is given, of one slab and a cylinder. A ray is
        inside the solid between its last entry and its first exit.
    """
    enter, leave, face = -inf, inf, WALL
    if radius > 0.0:
        enter, leave = _in_circle(radius, origin, ray)
    for i in range(2 if radius > 0.0 else 0, 3):
        if ray[i] == 0.0:
            if abs(origin[i]) > half[i]:
                return inf, face
            continue
        middle, reach = -origin[i] / ray[i], abs(half[i] / ray[i])
        if middle - reach > enter:
            enter, face = middle - reach, i
        leave = min(leave, middle + reach)
    return (enter if enter <= leave else inf), face


@compiled
def _in_circle(radius: float, origin: FloatArray, ray: FloatArray) -> tuple[float, float]:
    """Return the two distances between which a ray is inside a cylinder around the third axis, or (inf, -inf) if it
    never is."""
    a = ray[0] * ray[0] + ray[1] * ray[1]
    b = ray[0] * origin[0] + ray[1] * origin[1]
    c = origin[0] * origin[0] + origin[1] * origin[1] - radius * radius
    if a == 0.0:
        return (inf, -inf) if c > 0.0 else (-inf, inf)
    inside = b * b - a * c
    if inside < 0.0:
        return inf, -inf
    return (-b - sqrt(inside)) / a, (-b + sqrt(inside)) / a
