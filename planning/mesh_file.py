"""Read meshes from STL and OBJ files with MuJoCo."""

import math
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from drivers.paths import resolved
from hal.types import FloatArray
from planning.planning_errors import PlanningError
from planning.scene import Mesh

KINDS: Final = (".stl", ".obj")
"""File types that MuJoCo can read."""

MOST_TRIANGLES: Final = 200_000
"""Maximum number of triangles that MuJoCo reads from an STL file."""
HEADER_BYTES: Final = 84
TRIANGLE_BYTES: Final = 50
"""Sizes in a binary STL file. The header ends with the number of triangles, in four bytes."""


class MeshFileError(PlanningError):
    """A mesh file cannot be read."""

    def __init__(self, message: str) -> None:
        super().__init__("INVALID_OBJECT_NAME", message)


def read_mesh(path: Path, scale: float = 1.0) -> Mesh:
    """Read a mesh.

    Args:
        path: Binary STL or OBJ file, in m.
        scale: Factor applied to all lengths, such as 0.001 for a file in mm.

    Raises:
        MeshFileError: The file cannot be read or contains no triangles, or the scale is not finite or 0.
    """
    if not math.isfinite(scale) or scale == 0.0:
        raise MeshFileError(f"the scale of {path} is {scale:g}: use a finite number other than 0")
    if path.suffix.lower() not in KINDS:
        raise MeshFileError(f"{path} is neither an STL nor an OBJ file: convert the mesh to one of these formats")
    _check_readable(path)
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(resolved(path)), scale=[scale] * 3)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        model = spec.compile()
    except ValueError as error:
        raise MeshFileError(f"{path} {_problem(path, error)}") from error
    return Mesh(_original(model), np.array(model.mesh_face, dtype=np.int64))


def _check_readable(path: Path) -> None:
    try:
        if not path.is_file():
            raise MeshFileError(f"mesh file {path} does not exist: correct the path")
        path.open("rb").close()
    except OSError as error:
        raise MeshFileError(f"cannot read {path}: {error.strerror}: check the path and its permissions") from error


def _problem(path: Path, error: ValueError) -> str:
    """Return the reason why MuJoCo cannot read a mesh, with a remedy."""
    if path.suffix.lower() == ".stl":
        count = _triangles(path)
        if count is None:
            return "is not a mesh with a volume: it is not a binary STL file; save it as a binary STL"
        if count > MOST_TRIANGLES:
            return f"has {count} triangles, but at most {MOST_TRIANGLES} are possible: simplify the mesh"
    reason = str(error).splitlines()[0].removeprefix("Error: ").rstrip(".")
    return f"is not a mesh with a volume: {reason}; correct the mesh"


def _triangles(path: Path) -> int | None:
    """Return the number of triangles in a binary STL file, or None if the file has a different format."""
    with path.open("rb") as file:
        head = file.read(HEADER_BYTES)
    count = int.from_bytes(head[-4:], "little")
    return count if path.stat().st_size == HEADER_BYTES + TRIANGLE_BYTES * count else None


def _original(model: Any) -> FloatArray:
    """Return the vertices (v, 3) in the file's frame. MuJoCo moves the mesh's origin to the center of mass."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.mesh_quat[0])
    vertices: FloatArray = np.array(model.mesh_vert, dtype=float) @ matrix.reshape(3, 3).T + model.mesh_pos[0]
    return vertices
