"""Pinhole camera: its image size, focal length and pose."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """A camera without distortion, whose optical axis passes through the center of the image."""

    width: int
    height: int
    focal_px: float
    position_m: FloatArray
    """Position in the world, in meters, shape (3,)."""
    axes: FloatArray
    """Axes x (right), y (down) and z (forward) of the optical frame in world coordinates, as columns, shape (3, 3)."""

    @staticmethod
    def of(model: Any, data: Any, name: str, width: int = 640, height: int = 480) -> "PinholeCamera":
        """Return a camera of a MuJoCo scene whose poses must be up to date. MuJoCo's cameras look along their -z
        axis."""
        focal_px = 0.5 * height / np.tan(0.5 * np.radians(float(model.cam(name).fovy[0])))
        camera = data.cam(name)
        axes = camera.xmat.reshape(3, 3) * np.array([1.0, -1.0, -1.0])
        return PinholeCamera(width, height, float(focal_px), camera.xpos.copy(), axes)

    @staticmethod
    def looking_at(
        target_m: FloatArray, position_m: FloatArray, focal_px: float = 600.0, size: tuple[int, int] = (640, 480)
    ) -> "PinholeCamera":
        """Return an upright camera that looks at a point. The camera must not look straight down."""
        forward = (target_m - position_m) / np.linalg.norm(target_m - position_m)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        axes = np.column_stack([right, np.cross(forward, right), forward])
        return PinholeCamera(*size, focal_px, np.array(position_m, dtype=float), axes)

    @property
    def matrix(self) -> FloatArray:
        """The camera matrix K, shape (3, 3). Integer coordinates are pixel centers, as in OpenCV."""
        cx, cy = 0.5 * (self.width - 1), 0.5 * (self.height - 1)
        return np.array([[self.focal_px, 0.0, cx], [0.0, self.focal_px, cy], [0.0, 0.0, 1.0]])

    def pixels(self, points_m: FloatArray) -> FloatArray:
        """Return the pixel coordinates (n, 2) of world points (n, 3), with x to the right and y down."""
        seen = (points_m - self.position_m) @ self.axes
        middle = 0.5 * np.array([self.width - 1, self.height - 1])
        pixels: FloatArray = middle + self.focal_px * seen[:, :2] / seen[:, 2:]
        return pixels

    def rays(self, right: float = 0.0, down: float = 0.0) -> FloatArray:
        """Return unit vectors in world coordinates through all pixels, row by row, shape (height * width, 3).

        ``right`` and ``down`` shift the rays by this number of pixels.
        """
        x, y = np.meshgrid(np.arange(self.width) + right, np.arange(self.height) + down)
        middle_x, middle_y = 0.5 * (self.width - 1), 0.5 * (self.height - 1)
        rays = np.stack([x - middle_x, y - middle_y, np.full_like(x, self.focal_px)], axis=-1).reshape(-1, 3)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        # A matrix product would start the threads of the matrix library on processors that other programs may need.
        turned: FloatArray = np.einsum("ni,ji->nj", rays, self.axes)
        return np.ascontiguousarray(turned)
