"""Images of bodies on a floor, with the pixel coordinates of points, so that labels can be added."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion
from hal.robot_description.link_meshes import Faces, with_edges
from hal.types import FloatArray
from sim_backend.scene.drawn_model import add_mesh, add_shape
from sim_backend.scene.picture import CAMERA, Picture, View

FOVY_DEG: Final = 30.0
FLOOR_RGBA: Final = (0.86, 0.87, 0.88, 1.0)
LAMP: Final = np.array([0.3, -0.6, 1.2])
"""Position of the lamp relative to the center of the bodies, as a multiple of their radius."""
LAMP_RADII: Final = 4.0


@dataclass(frozen=True, slots=True)
class Solid:
    """A triangle mesh in the world: vertices (v, 3) in meters in its own frame, and faces (f, 3)."""

    vertices: FloatArray
    faces: Faces
    pose: tuple[Vector, Quaternion]
    rgb: Vector


@dataclass(frozen=True, slots=True)
class Still:
    """Image of shape (height, width, 3) and its camera."""

    picture: Picture
    eye: FloatArray
    axes: FloatArray
    """Axes x (right), y (up) and z (back) of the camera in world coordinates, as columns, shape (3, 3)."""
    focal_px: float

    def pixels(self, points: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of points (n, 3) of the world, x to the right and y down."""
        seen = (points - self.eye) @ self.axes
        height, width, _ = self.picture.shape
        scale = self.focal_px / -seen[:, 2]
        return np.column_stack([0.5 * width + seen[:, 0] * scale, 0.5 * height - seen[:, 1] * scale])


def take(
    solids: Iterable[Solid], toward: FloatArray, size: tuple[int, int], filled: tuple[float, float] = (0.9, 0.9)
) -> Still:
    """Render an image of ``size`` that shows all solids.

    Args:
        solids: The solids, which are on a floor below the lowest solid.
        toward: The direction (3,) from the solids to the camera.
        size: Width and height of the image, in pixels.
        filled: Maximum fraction of the width and of the height that the solids fill.
    """
    width, height = size
    spec: Any = mujoco.MjSpec()
    points = np.concatenate([_add(spec, str(number), solid) for number, solid in enumerate(solids)])
    lowest, highest = points.min(axis=0), points.max(axis=0)
    middle, radius = 0.5 * (lowest + highest), 0.5 * float(np.linalg.norm(highest - lowest))
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(type=plane, pos=(0.0, 0.0, lowest[2]), size=(0.0, 0.0, 0.1), rgba=FLOOR_RGBA)
    spec.worldbody.add_light(pos=middle + LAMP_RADII * radius * LAMP)
    axes = _axes(toward)
    focal_px = 0.5 * height / np.tan(0.5 * np.radians(FOVY_DEG))
    reach = 0.5 * np.array(size) * filled / focal_px
    eye = middle + axes[:, 2] * _distance((points - middle) @ axes, reach)
    spec.worldbody.add_camera(name=CAMERA, pos=eye, quat=_wxyz(axes), fovy=FOVY_DEG)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    picture = View(model, data, width=width, height=height).picture(data)
    return Still(picture, eye, axes, focal_px)


def _add(spec: Any, name: str, solid: Solid) -> FloatArray:
    """Add a solid and return its vertices (v, 3) in world coordinates."""
    add_mesh(spec, name, *with_edges(solid.vertices, solid.faces))
    add_shape(spec.worldbody, name, solid.pose, solid.rgb)
    position_m, (x, y, z, w) = solid.pose
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, np.array([w, x, y, z]))
    placed: FloatArray = solid.vertices @ turn.reshape(3, 3).T + position_m
    return placed


def _distance(points: FloatArray, reach: FloatArray) -> float:
    """Return the camera distance at which all points (n, 3), given in camera axes, are within ``reach`` (2,) per unit
    of depth."""
    return float((np.abs(points[:, :2]) / reach + points[:, 2:]).max())


def _axes(toward: FloatArray) -> FloatArray:
    """Return the axes of an upright camera that looks along ``-toward``."""
    back = toward / np.linalg.norm(toward)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(back, right), back])


def _wxyz(axes: FloatArray) -> FloatArray:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    return quaternion
