"""Where rays first meet the geoms of a MuJoCo model, in numpy. n is the number of rays.

MuJoCo says where the geoms are; its own mj_multiRay cuts pieces off them (it culls too much).
"""

from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Hits = tuple[Any, FloatArray, FloatArray]
"""Of each ray: geom (n,), -1 for none; distance (n,), infinite for none; normal (n, 3)."""

VISIBLE_GROUPS: Final = (0, 1, 2)
"""Geom groups that are drawn; the others only serve the simulation."""
PLANE: Final = int(mujoco.mjtGeom.mjGEOM_PLANE)
BOX: Final = int(mujoco.mjtGeom.mjGEOM_BOX)
CYLINDER: Final = int(mujoco.mjtGeom.mjGEOM_CYLINDER)


def turn(vectors: FloatArray, matrix: FloatArray) -> FloatArray:
    """`vectors @ matrix`, on one core: the threads of a matrix library cost more than they do here."""
    turned: FloatArray = np.einsum("ni,ij->nj", vectors, matrix)
    return turned


def visible(model: Any) -> Any:
    """All geoms that are drawn."""
    return np.flatnonzero(np.isin(model.geom_group, VISIBLE_GROUPS))


def no_hits(count: int) -> Hits:
    """What so many rays have hit before there is anything."""
    return np.full(count, -1), np.full(count, np.inf), np.zeros((count, 3))


def cast(model: Any, data: Any, origin: FloatArray, rays: FloatArray, geoms: Any, so_far: Hits | None = None) -> Hits:
    """First hit of each ray on one of ``geoms``, unless something nearer has been hit ``so_far``."""
    columns = np.asfortranarray(rays, dtype=np.float32)
    geom, nearest, normal = (values.copy() for values in so_far or no_hits(len(rays)))
    for i in geoms:
        axes, away = data.geom_xmat[i].reshape(3, 3), data.geom_xpos[i] - origin
        index = _candidates(columns, away, model.geom_rbound[i])
        distance, local = _hit(model.geom_type[i], model.geom_size[i], -away @ axes, turn(rays[index], axes))
        first = distance < nearest[index]
        index = index[first]
        nearest[index], geom[index] = distance[first], i
        normal[index] = turn(local[first], axes.T)
    return geom, nearest, normal


def _candidates(columns: Any, away: FloatArray, radius: float) -> Any:
    """Indices of the rays that meet the bounding sphere; all of them for a plane (radius 0).

    Most of the time goes here: single precision, column by column, and nothing but one comparison.
    """
    if radius == 0.0:
        return np.arange(len(columns))
    x, y, z = away.astype(np.float32)
    along = columns[:, 0] * x
    along += columns[:, 1] * y
    along += columns[:, 2] * z
    nearest = float(away @ away) - (1.001 * radius) ** 2
    return np.flatnonzero(along > np.float32(max(0.0, nearest) ** 0.5))


def _hit(kind: int, size: FloatArray, origin: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance (infinite for none) and normal of the first hit, all in the geom's own frame.

    The solids are convex, so each is a meeting of slabs (and a round wall): a ray is inside from the
    last entry to the first exit.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        if kind == PLANE:
            distance = np.where(rays[:, 2] < 0.0, -origin[2] / rays[:, 2], np.inf)
            return distance, np.tile([0.0, 0.0, 1.0], (len(rays), 1))
        half = size if kind == BOX else np.array([np.inf, np.inf, size[1]])
        middle, reach = -origin / rays, np.abs(half / rays)
        enter, leave = middle - reach, middle + reach
        normal = -np.sign(rays)
        if kind == CYLINDER:
            enter[:, 0], leave[:, 0], wall = _round_wall(size[0], origin[:2], rays[:, :2])
            enter[:, 1], leave[:, 1] = -np.inf, np.inf
        elif kind != BOX:
            raise ValueError(f"pictures are made of planes, boxes and cylinders; this is geom type {kind}")
    last = np.argmax(enter, axis=1)
    rows = np.arange(len(rays))
    distance = enter[rows, last]
    local = np.zeros_like(rays)
    local[rows, last] = normal[rows, last]
    if kind == CYLINDER:
        round_ = last == 0
        local[round_, :2] = wall[round_]
        local[round_, 2] = 0.0
    return np.where((distance <= leave.min(axis=1)) & (distance > 0.0), distance, np.inf), local


def _round_wall(radius: float, origin: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where rays in the plane enter and leave a circle about zero (NaN: never), and the wall's normal."""
    a = np.sum(rays * rays, axis=1)
    b = rays @ origin
    root = np.sqrt(b * b - a * (origin @ origin - radius * radius))
    enter = np.nan_to_num((-b - root) / a, nan=np.inf)
    return enter, np.nan_to_num((-b + root) / a, nan=-np.inf), (origin + rays * enter[:, None]) / radius
