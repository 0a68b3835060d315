"""Read the link meshes of an arm, which are used only for display. ``meshes/links.yaml`` in the arm's folder lists
these meshes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from hal.file_size import LARGEST_SHAPE_BYTES, REDUCE, check_size
from hal.hal_errors import ArmFileError
from hal.plausible import NoTruth, Position
from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion, from_rpy
from hal.text_file import exists
from hal.types import FloatArray
from hal.yaml_file import load

Faces = NDArray[np.int64]
PLACES: Final = Path("meshes", "links.yaml")
HEADER_BYTES: Final = 84
TRIANGLE: Final = np.dtype([("normal", "<3f4"), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
"""Layout of a triangle in a binary STL file."""
CREASE_RAD: Final = 0.35
"""Minimum angle between two faces at a sharp edge, in rad."""
ZERO: Final[Vector] = (0.0, 0.0, 0.0)
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False), NoTruth]


class MeshPlace(BaseModel):
    """Entry of ``links.yaml``: one mesh on a link."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    mesh: str
    """Path of a binary STL file with coordinates in meters, relative to the folder of ``links.yaml``."""
    xyz_m: tuple[Position, Position, Position] = ZERO
    rpy_rad: tuple[Position, Position, Position] = ZERO
    rgb: tuple[Share, Share, Share]


class MeshPlaces(BaseModel):
    """Content of ``links.yaml``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    links: dict[str, list[MeshPlace]]
    """Meshes by link name."""


@dataclass(frozen=True, slots=True)
class LinkMesh:
    """Mesh and its pose in the link frame, in meters."""

    link: str
    path: Path
    position_m: Vector
    quaternion: Quaternion
    rgb: Vector
    """Red, green and blue, each from 0 to 1."""


def link_meshes(folder: Path) -> list[LinkMesh]:
    """Read the meshes of the arm in a folder. Raise one ArmFileError that lists all errors. The list may be empty."""
    path = folder / PLACES
    if not exists(path, ArmFileError):
        return []
    links = load(path, MeshPlaces, ArmFileError).links
    return [
        LinkMesh(link, path.parent / one.mesh, one.xyz_m, from_rpy(one.rpy_rad), one.rgb)
        for link, meshes in links.items()
        for one in meshes
    ]


def read_stl(path: Path) -> tuple[FloatArray, Faces]:
    """Read a binary STL file.

    Returns:
        The unique vertices, shape (v, 3), in the file's unit, and the faces, shape (f, 3), as vertex indices.

    Raises:
        ArmFileError: The file cannot be read, is too large, or is not a binary STL file.
    """
    try:
        check_size(path, ArmFileError, LARGEST_SHAPE_BYTES, REDUCE)
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ArmFileError(f"{path} cannot be read: {reason}: correct the name in {PLACES.name}") from error
    triangles = int.from_bytes(content[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    if triangles == 0 or len(content) != HEADER_BYTES + triangles * TRIANGLE.itemsize:
        raise ArmFileError(f"{path} is not a binary STL file: export the mesh as binary STL")
    corners: Any = np.frombuffer(content, TRIANGLE, offset=HEADER_BYTES)["corners"]
    vertices, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    if not np.isfinite(vertices).all():
        raise ArmFileError(f"{path} has a vertex that is not finite: export the mesh again")
    return vertices.astype(np.float64), numbers.reshape(-1, 3).astype(np.int64)


def with_edges(vertices: FloatArray, faces: Faces, crease_rad: float = CREASE_RAD) -> tuple[FloatArray, Faces]:
    """Duplicate the vertices at sharp edges, so that smooth shading keeps the edges sharp.

    Args:
        vertices: Vertices, shape (v, 3).
        faces: Vertex indices, shape (f, 3).
        crease_rad: Minimum angle between two faces at a sharp edge, in rad.

    Returns:
        The vertices including the duplicates, and the faces as indices of these vertices.
    """
    normals = np.round(_corner_normals(vertices, faces, crease_rad), 4)
    corners: Any = np.column_stack([faces.ravel(), normals])
    apart, numbers = np.unique(corners, axis=0, return_inverse=True)
    return vertices[apart[:, 0].astype(np.int64)], numbers.reshape(-1, 3).astype(np.int64)


def _corner_normals(vertices: FloatArray, faces: Faces, crease_rad: float) -> FloatArray:
    """Return the normals at all corners, shape (3 f, 3).

    Each normal is the mean of the normals of the adjacent faces that are not separated by a sharp edge.
    """
    first, second, third = (vertices[faces[:, i]] for i in range(3))
    area = np.cross(second - first, third - first)
    flat = _units(area)
    corners = faces.ravel()
    order, count = np.argsort(corners, kind="stable"), np.bincount(corners, minlength=len(vertices))
    start = np.concatenate([[0], np.cumsum(count)])[corners]
    own, total = np.repeat(flat, 3, axis=0), np.zeros((len(corners), 3))
    for nth in range(int(count.max())):
        there = np.flatnonzero(nth < count[corners])
        other = order[start[there] + nth] // 3
        same = np.sum(own[there] * flat[other], axis=1) >= np.cos(crease_rad)
        total[there[same]] += area[other[same]]
    return _units(total)


def _units(vectors: FloatArray) -> FloatArray:
    unit: FloatArray = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
    return unit
