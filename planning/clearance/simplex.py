"""Find the point of a simplex that is nearest to the origin, in compiled code.

The corners of a simplex are rows of ``corners`` (4, 3), in m. The functions return the weight of each corner. A weight
of 0 means that the corner does not contribute to the nearest point.
"""

from typing import Any

from planning.clearance.compiled import compiled


@compiled
def _along(corners: Any, i: int, j: int, k: int) -> float:
    """Return the dot product of the edge from ``i`` to ``j`` and the vector from ``k`` to the origin."""
    x, y, z = corners[k, 0], corners[k, 1], corners[k, 2]
    ex, ey, ez = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1], corners[j, 2] - corners[i, 2]
    return float(-(ex * x + ey * y + ez * z))


@compiled
def on_edge(corners: Any, i: int, j: int) -> tuple[float, float]:
    """Return the weights of corners ``i`` and ``j``."""
    before, after = _along(corners, i, j, i), -_along(corners, i, j, j)
    if before <= 0.0:
        return 1.0, 0.0
    if after <= 0.0:
        return 0.0, 1.0
    return after / (before + after), before / (before + after)


@compiled
def on_face(corners: Any, i: int, j: int, k: int) -> tuple[float, float, float]:
    """Return the weights of corners ``i``, ``j`` and ``k`` (Ericson, Real-Time Collision Detection, 5.1.5)."""
    d1, d2 = _along(corners, i, j, i), _along(corners, i, k, i)
    d3, d4 = _along(corners, i, j, j), _along(corners, i, k, j)
    d5, d6 = _along(corners, i, j, k), _along(corners, i, k, k)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    at_i, at_j, at_k = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if at_k <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        one, other = on_edge(corners, i, j)
        return one, other, 0.0
    if at_j <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        one, other = on_edge(corners, i, k)
        return one, 0.0, other
    if at_i <= 0.0:
        one, other = on_edge(corners, j, k)
        return 0.0, one, other
    total = at_i + at_j + at_k
    return at_i / total, at_j / total, at_k / total


@compiled
def _side(corners: Any, face: tuple[int, int, int], point: tuple[float, float, float]) -> float:
    """Return six times the signed volume of the tetrahedron formed by a face and a point."""
    i, j, k = face
    ax, ay, az = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1], corners[j, 2] - corners[i, 2]
    bx, by, bz = corners[k, 0] - corners[i, 0], corners[k, 1] - corners[i, 1], corners[k, 2] - corners[i, 2]
    px, py, pz = point[0] - corners[i, 0], point[1] - corners[i, 1], point[2] - corners[i, 2]
    return float((ay * bz - az * by) * px + (az * bx - ax * bz) * py + (ax * by - ay * bx) * pz)


@compiled
def _norm(corners: Any, i: int, j: int, k: int, weights: tuple[float, float, float]) -> float:
    total = 0.0
    for axis in range(3):
        value = weights[0] * corners[i, axis] + weights[1] * corners[j, axis] + weights[2] * corners[k, axis]
        total += value * value
    return total


@compiled
def on_tetrahedron(corners: Any, weights: Any) -> bool:
    """Write the weights (4,) of the corners.

    Return whether the origin is inside. If it is inside, the weights are not written.
    """
    faces = ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1), (1, 2, 3, 0))
    best = 1e300
    for i, j, k, opposite in faces:
        apex = (corners[opposite, 0], corners[opposite, 1], corners[opposite, 2])
        if _side(corners, (i, j, k), (0.0, 0.0, 0.0)) * _side(corners, (i, j, k), apex) > 0.0:
            continue
        found = on_face(corners, i, j, k)
        norm = _norm(corners, i, j, k, found)
        if norm < best:
            best = norm
            weights[i], weights[j], weights[k], weights[opposite] = found[0], found[1], found[2], 0.0
    return best == 1e300
