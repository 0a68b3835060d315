"""Convert the world objects in a scene file to objects of a planning scene."""

from typing import Any

import mujoco
import numpy as np

from planning.arm_model import ArmModel
from planning.scene import Box, Cylinder, Mesh, Pose, SceneObject, Shape, Sphere


def world_objects(arm: ArmModel) -> dict[str, SceneObject]:
    """Return the world objects in a scene file, keyed by name, in their initial poses.

    Objects that contain a plane, a capsule or an ellipsoid are omitted, because a planning scene does not support these
    shapes.
    """
    data = mujoco.MjData(arm.model)
    mujoco.mj_kinematics(arm.model, data)
    found = {}
    for name, geoms in arm.world_geoms().items():
        parts = [(_shape(arm.model, geom), geom) for geom in geoms]
        body = int(arm.model.body_rootid[arm.model.geom_bodyid[geoms[0]]])
        own = Pose(np.array(data.xpos[body]), np.array(data.xmat[body]).reshape(3, 3))
        frame = own if body else _place(data, geoms[0])
        back = frame.inverse()
        shapes = tuple((shape, back @ _place(data, geom)) for shape, geom in parts if shape is not None)
        if len(shapes) == len(geoms):
            found[name] = SceneObject(name, shapes, frame)
    return found


def _place(data: Any, geom: int) -> Pose:
    return Pose(np.array(data.geom_xpos[geom]), np.array(data.geom_xmat[geom]).reshape(3, 3))


def _shape(model: Any, geom: int) -> Shape | None:
    kind, (x, y, z) = int(model.geom_type[geom]), (float(size) for size in model.geom_size[geom])
    if kind == int(mujoco.mjtGeom.mjGEOM_BOX):
        return Box(2.0 * x, 2.0 * y, 2.0 * z)
    if kind == int(mujoco.mjtGeom.mjGEOM_SPHERE):
        return Sphere(x)
    if kind == int(mujoco.mjtGeom.mjGEOM_CYLINDER):
        return Cylinder(2.0 * y, x)
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        start, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        vertices = np.array(model.mesh_vert[first : first + count], dtype=float)
        return Mesh(vertices, np.array(model.mesh_face[start : start + faces], dtype=np.int64))
    return None
