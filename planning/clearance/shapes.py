"""Compute support points of geom shapes and distances to points, in compiled code.

Every shape is a core, which may be a point or a segment, and a margin around the core. A geom is a row in a table of
floats (g, ``COLUMNS``), because passing a single array to compiled functions is fastest. Coordinates are in the geom's
frame, in m.
"""

from math import sqrt
from typing import Any, Final

from planning.clearance.compiled import compiled

POINT: Final = 0
"""Sphere: ``margin`` is its radius."""
SEGMENT: Final = 1
"""Capsule along z: ``size[2]`` is half the length without caps, and ``margin`` is the radius."""
BOX: Final = 2
"""Box: ``size`` contains half of each side length."""
CYLINDER: Final = 3
"""Cylinder along z: ``size[0]`` is the radius, and ``size[2]`` is half the height."""
CONE: Final = 4
"""Cone with its tip at +z: ``size[0]`` is the radius of the base, and ``size[2]`` is half the height."""
ELLIPSOID: Final = 5
"""Ellipsoid: ``size`` contains the half axes."""
HULL: Final = 6
"""Convex hull of vertices: ``size`` contains half of each side length of a box around the hull, with the same
center."""
PLANE: Final = 7
"""Half-space below z = 0."""


KIND: Final = 0
"""Column that contains the kind of shape."""
SIZE: Final = 1
"""First of three columns that contain the size."""
MARGIN: Final = 4
"""Column that contains the margin."""
RADIUS: Final = 5
"""Column that contains the radius of the sphere around the geom."""
POSITION: Final = 6
"""First of three columns that contain the position in the world frame."""
MATRIX: Final = 9
"""First of nine columns that contain the rotation matrix in the world frame, in row-major order."""
FIRST_VERTEX: Final = 18
"""Column that contains the index of a hull's first vertex."""
END_VERTEX: Final = 19
"""Column that contains the index after a hull's last vertex."""
SWING: Final = 20
"""Column that contains the distance from the center to the farthest point that a rotation moves, which is 0 for a
sphere."""
COLUMNS: Final = 21
"""Number of columns."""


@compiled
def farthest(geoms: Any, geom: int, vertices: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the point of a core that is farthest in a given direction. ``vertices`` (v, 3) contains the vertices of
    all hulls."""
    kind = geoms[geom, KIND]
    if kind == POINT:
        return 0.0, 0.0, 0.0
    if kind == HULL:
        first = int(geoms[geom, FIRST_VERTEX])
        best, found = first, -1e300
        for i in range(first, int(geoms[geom, END_VERTEX])):
            along = vertices[i, 0] * x + vertices[i, 1] * y + vertices[i, 2] * z
            if along > found:
                best, found = i, along
        return vertices[best, 0], vertices[best, 1], vertices[best, 2]
    a, b, c = geoms[geom, SIZE], geoms[geom, SIZE + 1], geoms[geom, SIZE + 2]
    if kind == ELLIPSOID:
        norm = sqrt(a * a * x * x + b * b * y * y + c * c * z * z)
        return a * a * x / norm, b * b * y / norm, c * c * z / norm
    top = c if z >= 0.0 else -c
    if kind == SEGMENT:
        return 0.0, 0.0, top
    if kind == BOX:
        return a if x >= 0.0 else -a, b if y >= 0.0 else -b, top
    across = sqrt(x * x + y * y)
    if kind == CONE:
        if z * 2.0 * c >= across * a:
            return 0.0, 0.0, c
        top = -c
    if across < 1e-300:
        return 0.0, 0.0, top
    return a * x / across, a * y / across, top


@compiled
def point_distance(geoms: Any, geom: int, x: float, y: float, z: float) -> float:
    """Return the distance of a point from a core.

    The distance is exact for points, segments, boxes, cylinders and planes. For other cores, the result is a lower
    bound. The distance is 0 inside a core, and negative below a plane.
    """
    kind = geoms[geom, KIND]
    if kind == PLANE:
        return z
    if kind == POINT:
        return sqrt(x * x + y * y + z * z)
    above = max(abs(z) - geoms[geom, SIZE + 2], 0.0)
    if kind == SEGMENT:
        return sqrt(x * x + y * y + above * above)
    if kind in (CYLINDER, CONE):
        beside = max(sqrt(x * x + y * y) - geoms[geom, SIZE], 0.0)
        return sqrt(beside * beside + above * above)
    a, b = max(abs(x) - geoms[geom, SIZE], 0.0), max(abs(y) - geoms[geom, SIZE + 1], 0.0)
    return sqrt(a * a + b * b + above * above)


@compiled
def point_direction(geoms: Any, geom: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the vector from the nearest point of a core to a point outside the core, provided that ``point_distance``
    is exact."""
    kind, top = geoms[geom, KIND], geoms[geom, SIZE + 2]
    if kind == PLANE:
        return 0.0, 0.0, 1.0
    if kind == POINT:
        return x, y, z
    above = z - min(max(z, -top), top)
    if kind == SEGMENT:
        return x, y, above
    if kind == CYLINDER:
        across = sqrt(x * x + y * y)
        share = max(1.0 - geoms[geom, SIZE] / max(across, 1e-300), 0.0)
        return x * share, y * share, above
    a, b = geoms[geom, SIZE], geoms[geom, SIZE + 1]
    return x - min(max(x, -a), a), y - min(max(y, -b), b), above


@compiled
def is_exact(kind: float) -> bool:
    """Return whether ``point_distance`` is exact for this kind of shape."""
    return kind <= CYLINDER or kind == PLANE
