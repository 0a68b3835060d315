"""Camera of a generated scene, which shows the whole arm."""

from typing import Any

import mujoco
import numpy as np

from sim_backend.scene.cube_cell import FloatArray


def overview_camera(middle: FloatArray, toward: FloatArray, distance_m: float) -> dict[str, Any]:
    """Return the settings of a camera that looks at a point.

    Args:
        middle: Point in the center of the image, shape (3,), in m.
        toward: Direction from this point to the camera, shape (3,).
        distance_m: Distance between the camera and this point, in m.
    """
    back = toward / np.linalg.norm(toward)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back], axis=1)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    return {"pos": middle + distance_m * back, "quat": quaternion}
