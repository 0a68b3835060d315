"""Distances between geoms and between units in compiled code. planning/clearance/shapes.py defines the shapes."""

from math import sqrt
from typing import Any

from planning.clearance.compiled import compiled
from planning.clearance.convex_distance import core_distance, in_frame, in_world, support
from planning.clearance.shapes import (
    KIND,
    MARGIN,
    MATRIX,
    PLANE,
    POINT,
    POSITION,
    RADIUS,
    is_exact,
    point_direction,
    point_distance,
)


@compiled
def _from_center(geoms: Any, geom: int, cx: float, cy: float, cz: float) -> float:
    """Return the distance of a point from a geom, or a lower bound on the distance."""
    x, y, z = cx - geoms[geom, POSITION], cy - geoms[geom, POSITION + 1], cz - geoms[geom, POSITION + 2]
    if geoms[geom, KIND] != POINT:
        x, y, z = in_frame(geoms, geom, x, y, z)
    return float(point_distance(geoms, geom, x, y, z) - geoms[geom, MARGIN])


@compiled
def _from_geom(geoms: Any, geom: int, other: int) -> float:
    """Return the distance of the center of ``other`` from a geom, or a lower bound on the distance."""
    x, y, z = geoms[other, POSITION], geoms[other, POSITION + 1], geoms[other, POSITION + 2]
    return _from_center(geoms, geom, x, y, z)


@compiled
def _write_normal(geoms: Any, geom: int, other: int, normal: Any) -> None:
    """Write the direction from the nearest point of ``geom`` to the center of ``other``, or 0 if the center is
    inside."""
    x, y, z = (
        geoms[other, POSITION] - geoms[geom, POSITION],
        geoms[other, POSITION + 1] - geoms[geom, POSITION + 1],
        geoms[other, POSITION + 2] - geoms[geom, POSITION + 2],
    )
    if geoms[geom, KIND] != POINT:
        x, y, z = in_frame(geoms, geom, x, y, z)
        x, y, z = point_direction(geoms, geom, x, y, z)
        x, y, z = in_world(geoms, geom, x, y, z)
    length = max(sqrt(x * x + y * y + z * z), 1e-300)
    normal[0], normal[1], normal[2] = x / length, y / length, z / length


@compiled
def unit_bound(geoms: Any, centers: Any, radii: Any, first: Any, one: int, other: int) -> float:
    """Return a lower bound on the distance between two units, based on the spheres around them."""
    ax, ay, az = centers[one, 0], centers[one, 1], centers[one, 2]
    bx, by, bz = centers[other, 0], centers[other, 1], centers[other, 2]
    if first[other + 1] - first[other] == 1:
        bound = _from_center(geoms, first[other], ax, ay, az) - radii[one]
    else:
        bound = sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2) - radii[one] - radii[other]
    if first[one + 1] - first[one] == 1:
        bound = max(bound, _from_center(geoms, first[one], bx, by, bz) - radii[other])
    return float(bound)


@compiled
def _core_distance(geoms: Any, one: int, other: int, vertices: Any, goal: tuple[float, float], normal: Any) -> float:
    margin = geoms[one, MARGIN] + geoms[other, MARGIN]
    if geoms[other, KIND] == PLANE:
        nx, ny, nz = geoms[other, MATRIX + 2], geoms[other, MATRIX + 5], geoms[other, MATRIX + 8]
        normal[0], normal[1], normal[2] = nx, ny, nz
        x, y, z = support(geoms, one, vertices, -nx, -ny, -nz)
        x, y, z = x - geoms[other, POSITION], y - geoms[other, POSITION + 1], z - geoms[other, POSITION + 2]
        return float(nx * x + ny * y + nz * z - margin)
    return float(core_distance(geoms, one, other, vertices, (goal[0] + margin, goal[1]), normal) - margin)


@compiled
def geom_distance(geoms: Any, one: int, other: int, vertices: Any, goal: tuple[float, float], normal: Any) -> float:
    """Return the distance between two geoms, or a lower bound above ``goal[0]``.

    ``goal`` is (beyond, share) as in ``core_distance``. If the distance is at most ``goal[0]``, its direction is
    written to ``normal`` (3,).
    """
    if geoms[one, KIND] == PLANE:
        one, other = other, one
    if geoms[one, KIND] == PLANE:
        return 1e300
    bound = _from_geom(geoms, other, one) - geoms[one, RADIUS]
    if geoms[one, KIND] == POINT and is_exact(geoms[other, KIND]):
        if bound <= goal[0]:
            _write_normal(geoms, other, one, normal)
        return float(bound)
    if geoms[other, KIND] != PLANE:
        back = _from_geom(geoms, one, other) - geoms[other, RADIUS]
        if geoms[other, KIND] == POINT and is_exact(geoms[one, KIND]):
            if back <= goal[0]:
                _write_normal(geoms, one, other, normal)
            return float(back)
        bound = max(bound, back)
    if bound > goal[0]:
        return float(bound)
    return _core_distance(geoms, one, other, vertices, goal, normal)
