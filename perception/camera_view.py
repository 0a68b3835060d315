"""Convert between pixels of a calibrated camera above a plane and rays or points in base_link."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import cv2
import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from hal.rotations import matrices, quaternions
from hal.types import FloatArray
from hal.yaml_file import load
from perception.intrinsics import Intrinsics
from perception.perception_errors import CameraFileError

LOWEST_SLOPE: Final = 0.05
"""Minimum downward slope of a ray that is intersected with the plane. A shallower ray meets the plane too far away."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Pose of a camera in base_link, and the plane that the camera observes."""

    rotation: FloatArray
    """Rotation (3, 3) from the optical frame (x right, y down, z forward) to base_link."""
    position_m: FloatArray
    """Position (3,) of the camera in base_link, in m."""
    plane_height_m: float
    """z of the plane on which the apples lie, in base_link, in m."""
    camera: str = "camera"
    """Name of the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraView:
    """Calibrated camera with its intrinsics and its pose."""

    intrinsics: Intrinsics
    pose: CameraPose

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return the unit vectors (n, 3) in base_link that point from the camera toward pixels (n, 2)."""
        points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        flat = cv2.undistortPoints(points, self.intrinsics.matrix, self.intrinsics.distortion).reshape(-1, 2)
        rays = np.column_stack([flat, np.ones(len(flat))]) @ self.pose.rotation.T
        directions: FloatArray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return directions

    def pixels(self, points_m: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of points (n, 3) in base_link, in m.

        The result is NaN for points behind the camera.
        """
        local = (np.atleast_2d(points_m) - self.pose.position_m) @ self.pose.rotation
        ahead = local[:, 2] > 1e-6
        pixels = np.full((len(local), 2), np.nan)
        if ahead.any():
            seen = np.ascontiguousarray(local[ahead]).reshape(-1, 1, 3)
            none = np.zeros(3)
            projected = cv2.projectPoints(seen, none, none, self.intrinsics.matrix, self.intrinsics.distortion)[0]
            pixels[ahead] = projected.reshape(-1, 2)
        return pixels

    def on_plane(self, pixels: FloatArray) -> FloatArray:
        """Return the points (n, 3) of the plane at pixels (n, 2), in m.

        The result is NaN for pixels that do not show the plane.
        """
        rays = self.rays(pixels)
        down = np.where(rays[:, 2] < -LOWEST_SLOPE, rays[:, 2], np.nan)
        lengths_m = (self.pose.plane_height_m - self.pose.position_m[2]) / down
        points_m: FloatArray = self.pose.position_m + lengths_m[:, np.newaxis] * rays
        return points_m


class _PoseFile(BaseModel):
    model_config = ConfigDict(extra="forbid")
    camera_name: str
    position_m: Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
    orientation_xyzw: Annotated[list[FiniteFloat], Field(min_length=4, max_length=4)]
    plane_height_m: FiniteFloat

    @model_validator(mode="after")
    def _usable(self) -> "_PoseFile":
        length = float(np.linalg.norm(self.orientation_xyzw))
        if abs(length - 1.0) > 1e-3:
            raise ValueError(f"orientation_xyzw has length {length:.4g} instead of 1: calibrate the plane again")
        if self.position_m[2] <= self.plane_height_m:
            raise ValueError(
                f"the camera at z = {self.position_m[2]} m is not above the plane at {self.plane_height_m} m: "
                "calibrate the plane again"
            )
        return self


def read_pose(path: Path, camera: str) -> CameraPose:
    """Read the pose of a camera.

    Args:
        path: File written by ``servoloop camera plane``.
        camera: Name of the camera, as stated in its intrinsics.

    Raises:
        CameraFileError: The file has errors, or belongs to a different camera.
    """
    file = load(path, _PoseFile, CameraFileError)
    if file.camera_name != camera:
        raise CameraFileError(
            f"{path} contains the pose of camera {file.camera_name}, but the intrinsics are those of {camera}: specify "
            f"two files for the same camera"
        )
    quaternion = np.array(file.orientation_xyzw)
    return CameraPose(
        matrices(quaternion / np.linalg.norm(quaternion)),
        np.array(file.position_m),
        file.plane_height_m,
        file.camera_name,
    )


def pose_text(pose: CameraPose) -> str:
    """Return the content of a file that ``read_pose`` can read."""
    content = {
        "camera_name": pose.camera,
        "position_m": [round(float(value), 6) for value in pose.position_m],
        "orientation_xyzw": [round(float(value), 9) for value in quaternions(pose.rotation)],
        "plane_height_m": round(pose.plane_height_m, 6),
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)


def looking_at(position_m: FloatArray, target_m: FloatArray, plane_height_m: float) -> CameraPose:
    """Return the pose of a camera that is aimed at a target. The far side of the plane is at the top of the image.

    Args:
        position_m: Position (3,) of the camera in base_link, in m.
        target_m: Point (3,) in the center of the image, in m.
        plane_height_m: z of the plane, in m.
    """
    forward = np.asarray(target_m, dtype=np.float64) - position_m
    forward = forward / np.linalg.norm(forward)
    side = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(side) < 1e-6:
        side = np.array([0.0, -1.0, 0.0])
    right = side / np.linalg.norm(side)
    rotation = np.column_stack([right, np.cross(forward, right), forward])
    return CameraPose(rotation, np.asarray(position_m, dtype=np.float64), plane_height_m)
