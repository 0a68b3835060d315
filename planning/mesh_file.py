"""Read meshes from STL and OBJ files with MuJoCo."""

from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from hal.types import FloatArray
from planning.planning_errors import PlanningError
from planning.scene import Mesh

KINDS: Final = (".stl", ".obj")
"""File types that MuJoCo can read."""


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
        MeshFileError: The file cannot be read or contains no triangles.
    """
    if path.suffix.lower() not in KINDS:
        raise MeshFileError(f"{path} is neither an STL nor an OBJ file: convert the mesh to one of these formats")
    if not path.is_file():
        raise MeshFileError(f"mesh file {path} does not exist: correct the path")
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(path.resolve()), scale=[scale] * 3)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        model = spec.compile()
    except ValueError as error:
        raise MeshFileError(f"{path} is not a mesh with a volume: {_reason(error)}; save it as a binary STL") from error
    return Mesh(_original(model), np.array(model.mesh_face, dtype=np.int64))


def _reason(error: ValueError) -> str:
    """Return the first line of a MuJoCo error message, without its prefix."""
    return str(error).splitlines()[0].removeprefix("Error: ").rstrip(".")


def _original(model: Any) -> FloatArray:
    """Return the vertices (v, 3) in the file's frame. MuJoCo moves the mesh's origin to the center of mass."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.mesh_quat[0])
    vertices: FloatArray = np.array(model.mesh_vert, dtype=float) @ matrix.reshape(3, 3).T + model.mesh_pos[0]
    return vertices
