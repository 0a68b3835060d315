"""First hits of rays on a mesh of a MuJoCo model. Compiled code searches the tree of boxes that MuJoCo builds for each
mesh."""

from math import inf, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backend.compiled import compiled
from sim_backend.scene.ray_types import FloatArray, GeomView, RayHits

Xyz = tuple[float, float, float]
DEPTH: Final = 64
"""Size of the traversal stack. Each level of the tree halves the number of triangles."""
EDGE: Final = 1e-6
"""Maximum distance from a triangle at which a ray is still considered to hit it, as a fraction of the triangle's size.

This tolerance closes gaps between triangles.
"""
THICK_M: Final = 1e-9
"""Thickness added to the boxes of the tree, in meters, because the boxes of flat parts would otherwise have no
thickness."""

ASKEW: Final = 1e-12


class MeshParts(NamedTuple):
    """Arrays of a mesh with v vertices, f faces, m normals and b boxes in its tree."""

    vertices: NDArray[np.float32]
    """Vertices, shape (v, 3), in the geom's frame."""
    faces: NDArray[np.int32]
    """Vertex indices of each face, shape (f, 3)."""
    normals: NDArray[np.float32]
    """Normals, shape (m, 3)."""
    face_normals: NDArray[np.int32]
    """Normal indices of each face, shape (f, 3)."""
    boxes: FloatArray
    """Center and half size of each box, shape (b, 6)."""
    children: NDArray[np.int32]
    """Child indices of each box, shape (b, 2); -1 if there is no child."""
    face_of: NDArray[np.int32]
    """Face index of each leaf, shape (b,); -1 for other boxes."""


def mesh_parts(model: Any, mesh: int) -> MeshParts:
    """Return the arrays of one mesh of a model."""
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    normal, box = model.mesh_normaladr[mesh], model.mesh_bvhadr[mesh]
    faces, boxes = slice(face, face + model.mesh_facenum[mesh]), slice(box, box + model.mesh_bvhnum[mesh])
    return MeshParts(
        model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]],
        model.mesh_face[faces],
        model.mesh_normal[normal : normal + model.mesh_normalnum[mesh]],
        model.mesh_facenormal[faces],
        model.bvh_aabb[boxes],
        model.bvh_child[boxes],
        model.bvh_nodeid[boxes],
    )


@compiled
def cast_mesh(parts: MeshParts, view: GeomView, hits: RayHits) -> None:
    """Store each ray's hit on one mesh if it is nearer than the hit stored so far."""
    number, axes, away, origin, beside = view
    rays, geom, nearest, normal = hits
    x, y, z = away
    start = (origin[0], origin[1], origin[2])
    stack = np.empty(DEPTH, np.int32)
    for n in range(len(rays)):
        if rays[n, 0] * x + rays[n, 1] * y + rays[n, 2] * z <= beside:
            continue
        ray = (
            rays[n, 0] * axes[0, 0] + rays[n, 1] * axes[1, 0] + rays[n, 2] * axes[2, 0],
            rays[n, 0] * axes[0, 1] + rays[n, 1] * axes[1, 1] + rays[n, 2] * axes[2, 1],
            rays[n, 0] * axes[0, 2] + rays[n, 1] * axes[1, 2] + rays[n, 2] * axes[2, 2],
        )
        distance, face = _first_face(parts, start, ray, nearest[n], stack)
        if face >= 0:
            nearest[n], geom[n] = distance, number
            nx, ny, nz = _normal(parts, face, start, ray)
            for i in range(3):
                normal[n, i] = axes[i, 0] * nx + axes[i, 1] * ny + axes[i, 2] * nz


@compiled
def _first_face(parts: MeshParts, origin: Xyz, ray: Xyz, nearest: float, stack: NDArray[np.int32]) -> tuple[float, int]:
    """Return the distance and the face of the first hit that is nearer than ``nearest``; the face is -1 if there is no
    such hit."""
    pace = (_inverse(ray[0]), _inverse(ray[1]), _inverse(ray[2]))
    found, count = -1, 0
    if _entry(parts.boxes, 0, origin, pace) < nearest:
        stack[0], count = 0, 1
    while count > 0:
        count -= 1
        box = stack[count]
        face = parts.face_of[box]
        if face >= 0:
            distance, _, _ = _on_triangle(parts, face, origin, ray)
            if 0.0 < distance < nearest:
                nearest, found = distance, face
            continue
        near, far = parts.children[box, 0], parts.children[box, 1]
        to_near = _entry(parts.boxes, near, origin, pace) if near >= 0 else inf
        to_far = _entry(parts.boxes, far, origin, pace) if far >= 0 else inf
        if to_far < to_near:
            near, far, to_near, to_far = far, near, to_far, to_near
        if to_far < nearest:
            stack[count] = far
            count += 1
        if to_near < nearest:  # The nearer box is pushed last, so it is visited next.
            stack[count] = near
            count += 1
    return nearest, found


@compiled
def _inverse(value: float) -> float:
    """Return the reciprocal of one component of a direction. A component near 0 is replaced by a small value."""
    return 1.0 / value if abs(value) > ASKEW else (1.0 / ASKEW if value >= 0.0 else -1.0 / ASKEW)


@compiled
def _entry(boxes: FloatArray, box: int, origin: Xyz, pace: Xyz) -> float:
    """Return the distance at which a ray enters a box: 0 if the ray starts inside the box, infinite if it misses the
    box.

    ``pace`` contains the reciprocals of the direction's components.
    """
    enter, leave = 0.0, inf
    for i in range(3):
        middle = (boxes[box, i] - origin[i]) * pace[i]
        reach = (boxes[box, 3 + i] + THICK_M) * abs(pace[i])
        enter, leave = max(enter, middle - reach), min(leave, middle + reach)
    return enter if enter <= leave else inf


@compiled
def _on_triangle(parts: MeshParts, face: int, origin: Xyz, ray: Xyz) -> tuple[float, float, float]:
    """Return the distance of a hit from either side, and the weights of the second and third corners. The distance is
    infinite if the ray misses.

    This function uses the Möller-Trumbore method.
    """
    a = _row(parts.vertices, parts.faces[face, 0])
    first = _between(a, _row(parts.vertices, parts.faces[face, 1]))
    second = _between(a, _row(parts.vertices, parts.faces[face, 2]))
    p = _cross(ray, second)
    across = _dot(first, p)
    if across == 0.0:
        return inf, 0.0, 0.0
    away = _between(a, origin)
    q = _cross(away, first)
    u, v = _dot(away, p) / across, _dot(ray, q) / across
    if u < -EDGE or v < -EDGE or u + v > 1.0 + EDGE:
        return inf, 0.0, 0.0
    return _dot(second, q) / across, u, v


@compiled
def _normal(parts: MeshParts, face: int, origin: Xyz, ray: Xyz) -> Xyz:
    """Return the normal at a hit, interpolated from the corner normals, on the side from which the ray comes."""
    _, u, v = _on_triangle(parts, face, origin, ray)
    a, b, c = parts.face_normals[face, 0], parts.face_normals[face, 1], parts.face_normals[face, 2]
    x = (1.0 - u - v) * parts.normals[a, 0] + u * parts.normals[b, 0] + v * parts.normals[c, 0]
    y = (1.0 - u - v) * parts.normals[a, 1] + u * parts.normals[b, 1] + v * parts.normals[c, 1]
    z = (1.0 - u - v) * parts.normals[a, 2] + u * parts.normals[b, 2] + v * parts.normals[c, 2]
    length = sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return -ray[0], -ray[1], -ray[2]
    if x * ray[0] + y * ray[1] + z * ray[2] > 0.0:
        length = -length
    return x / length, y / length, z / length


@compiled
def _row(values: NDArray[np.float32], row: int) -> Xyz:
    return float(values[row, 0]), float(values[row, 1]), float(values[row, 2])


@compiled
def _between(a: Xyz, b: Xyz) -> Xyz:
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


@compiled
def _cross(a: Xyz, b: Xyz) -> Xyz:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _dot(a: Xyz, b: Xyz) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
