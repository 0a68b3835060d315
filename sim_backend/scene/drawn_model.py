"""Model for rendering: a scene in which the real link shapes replace the boxes."""

from collections.abc import Iterable
from typing import Any, Final

import mujoco
import numpy as np

from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion
from hal.robot_description.link_meshes import Faces, LinkMesh, read_stl, with_edges
from hal.types import FloatArray

UNSEEN_GROUP: Final = 3
"""Geom group of boxes that are replaced by real shapes. MuJoCo's own viewer can show them."""


def drawn_model(spec: Any, meshes: Iterable[LinkMesh]) -> Any:
    """Compile a scene together with the link meshes. The meshes have no mass and no contacts.

    Meshes of links that are not in the scene are omitted.
    """
    bodies = {body.name: body for body in spec.bodies}
    replaced: dict[str, list[Any]] = {
        mesh.link: list(bodies[mesh.link].geoms) for mesh in meshes if mesh.link in bodies
    }
    for boxes in replaced.values():
        for box in boxes:
            box.group = UNSEEN_GROUP
    known: set[str] = set()
    for mesh in meshes:
        if mesh.link not in bodies:
            continue
        name = str(mesh.path)
        if name not in known:
            add_mesh(spec, name, *with_edges(*read_stl(mesh.path)))
            known.add(name)
        add_shape(bodies[mesh.link], name, (mesh.position_m, mesh.quaternion), mesh.rgb)
    return spec.compile()


def add_mesh(spec: Any, name: str, vertices: FloatArray, faces: Faces) -> None:
    """Add a named triangle mesh to a specification."""
    mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = vertices.ravel()
    mesh.userface = faces.astype(np.int32).ravel()


def add_shape(body: Any, name: str, pose: tuple[Vector, Quaternion], rgb: Vector) -> None:
    """Show a mesh on a body. ``pose`` is the pose of the mesh in the body frame."""
    position_m, (x, y, z, w) = pose
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        pos=position_m,
        quat=(w, x, y, z),
        rgba=(*rgb, 1.0),
        contype=0,
        conaffinity=0,
        mass=0.0,
        group=0,
    )
