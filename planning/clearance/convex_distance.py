"""Distance between two convex shapes in compiled code, with the GJK algorithm (Gilbert, Johnson and Keerthi)."""

from math import sqrt
from typing import Any, Final

import numpy as np

from planning.clearance.compiled import compiled
from planning.clearance.shapes import MATRIX, POSITION, farthest
from planning.clearance.simplex import on_edge, on_face, on_tetrahedron

ROUNDS: Final = 60
"""Maximum number of iterations. Most pairs take fewer than ten."""
OVERLAP_M2: Final = 1e-20
"""Squared distance below which two cores are considered overlapping, in m²."""


@compiled
def in_frame(geoms: Any, geom: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Transform a vector from the world frame to a geom's frame."""
    m = MATRIX
    return (
        geoms[geom, m] * x + geoms[geom, m + 3] * y + geoms[geom, m + 6] * z,
        geoms[geom, m + 1] * x + geoms[geom, m + 4] * y + geoms[geom, m + 7] * z,
        geoms[geom, m + 2] * x + geoms[geom, m + 5] * y + geoms[geom, m + 8] * z,
    )


@compiled
def in_world(geoms: Any, geom: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Transform a vector from a geom's frame to the world frame."""
    m = MATRIX
    return (
        geoms[geom, m] * x + geoms[geom, m + 1] * y + geoms[geom, m + 2] * z,
        geoms[geom, m + 3] * x + geoms[geom, m + 4] * y + geoms[geom, m + 5] * z,
        geoms[geom, m + 6] * x + geoms[geom, m + 7] * y + geoms[geom, m + 8] * z,
    )


@compiled
def support(geoms: Any, geom: int, vertices: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the point of a geom's core that is farthest in a given direction, in the world frame."""
    a, b, c = in_frame(geoms, geom, x, y, z)
    a, b, c = farthest(geoms, geom, vertices, a, b, c)
    a, b, c = in_world(geoms, geom, a, b, c)
    return a + geoms[geom, POSITION], b + geoms[geom, POSITION + 1], c + geoms[geom, POSITION + 2]


@compiled
def _nearest(corners: Any, count: int, weights: Any) -> bool:
    """Write the weights of the corners, and return whether the corners form a tetrahedron that contains the origin."""
    if count == 1:
        weights[0] = 1.0
    elif count == 2:
        weights[0], weights[1] = on_edge(corners, 0, 1)
    elif count == 3:
        weights[0], weights[1], weights[2] = on_face(corners, 0, 1, 2)
    else:
        return on_tetrahedron(corners, weights)
    return False


@compiled
def _without_idle(corners: Any, count: int, weights: Any) -> int:
    """Remove the corners with weight 0, and return the number of remaining corners."""
    kept = 0
    for i in range(count):
        if weights[i] > 0.0:
            for axis in range(3):
                corners[kept, axis] = corners[i, axis]
            weights[kept] = weights[i]
            kept += 1
    return kept


@compiled
def core_distance(geoms: Any, one: int, other: int, vertices: Any, goal: tuple[float, float], normal: Any) -> float:
    """Return a lower bound on the distance between two cores, in m, or 0 if they overlap.

    ``goal`` is (beyond, share). The bound underestimates the distance by at most the fraction ``share``. The search
    stops early if the bound exceeds ``beyond``, in m. ``normal`` (3,) is the direction along which the bound separates
    the cores.
    """
    corners = np.empty((4, 3))
    weights = np.empty(4)
    beyond_m, share = goal
    p = POSITION
    x, y = geoms[one, p] - geoms[other, p], geoms[one, p + 1] - geoms[other, p + 1]
    z = geoms[one, p + 2] - geoms[other, p + 2]
    if x * x + y * y + z * z < OVERLAP_M2:
        x = 1.0
    count, bound, last = 0, 0.0, 1e300
    for _ in range(ROUNDS):
        square = x * x + y * y + z * z
        if square < OVERLAP_M2:
            return 0.0
        ax, ay, az = support(geoms, one, vertices, -x, -y, -z)
        bx, by, bz = support(geoms, other, vertices, x, y, z)
        wx, wy, wz = ax - bx, ay - by, az - bz
        along = x * wx + y * wy + z * wz
        norm = sqrt(square)
        if along / norm > bound:
            bound = along / norm
            normal[0], normal[1], normal[2] = x / norm, y / norm, z / norm
        if bound > beyond_m or (count > 0 and (square - along <= share * square or square >= last)):
            break
        last = square if count > 0 else last
        corners[count, 0], corners[count, 1], corners[count, 2] = wx, wy, wz
        count += 1
        if _nearest(corners, count, weights):
            return 0.0
        count = _without_idle(corners, count, weights)
        x = y = z = 0.0
        for i in range(count):
            x += weights[i] * corners[i, 0]
            y += weights[i] * corners[i, 1]
            z += weights[i] * corners[i, 2]
    return bound
