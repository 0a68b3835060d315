"""Read and write camera intrinsics in the file format of camera_calibration (camera.yaml)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveInt, model_validator

from hal.types import FloatArray
from hal.yaml_file import load
from perception.perception_errors import CameraFileError

MODELS: Final = {"plumb_bob": 5, "rational_polynomial": 8}
"""Number of distortion coefficients of each supported distortion model."""


@dataclass(frozen=True, slots=True, eq=False)
class Intrinsics:
    """Focal lengths, principal point and lens distortion of a camera at one resolution."""

    matrix: FloatArray
    """Camera matrix K (3, 3), in pixels."""
    distortion: FloatArray
    """OpenCV coefficients: k1, k2, p1, p2, k3 (5,), and also k4, k5, k6 (8,) for the rational model."""
    width: int
    """Image width, in pixels."""
    height: int
    """Image height, in pixels."""
    name: str = "camera"
    """Name of the camera, which distinguishes the calibrations of several cameras."""

    @classmethod
    def pinhole(cls, focal_px: float, width: int, height: int, name: str = "camera") -> "Intrinsics":
        """Return the intrinsics of a camera without distortion. The principal point is the center of the image."""
        matrix = np.array([[focal_px, 0.0, (width - 1) / 2], [0.0, focal_px, (height - 1) / 2], [0.0, 0.0, 1.0]])
        return cls(matrix, np.zeros(5), width, height, name)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, in pixels."""
        return self.width, self.height

    @property
    def distortion_model(self) -> str:
        """Name of the distortion model in ROS."""
        return next(model for model, count in MODELS.items() if count == len(self.distortion))

    @property
    def projection(self) -> FloatArray:
        """Projection matrix (3, 4) of a monocular camera, in pixels."""
        return np.hstack([self.matrix, np.zeros((3, 1))])


class _Matrix(BaseModel):
    """A matrix in the layout of OpenCV's YAML files."""

    model_config = ConfigDict(extra="ignore")
    rows: PositiveInt
    cols: PositiveInt
    data: list[FiniteFloat]

    @model_validator(mode="after")
    def _complete(self) -> "_Matrix":
        if len(self.data) != self.rows * self.cols:
            raise ValueError(f"has {len(self.data)} values instead of {self.rows} × {self.cols}: correct the matrix")
        return self

    def array(self) -> FloatArray:
        return np.array(self.data, dtype=np.float64).reshape(self.rows, self.cols)


class _CameraFile(BaseModel):
    model_config = ConfigDict(extra="ignore")
    image_width: Annotated[int, Field(ge=16, le=16384)]
    image_height: Annotated[int, Field(ge=16, le=16384)]
    camera_name: str = "camera"
    camera_matrix: _Matrix
    distortion_model: Literal["plumb_bob", "rational_polynomial"]
    distortion_coefficients: _Matrix

    @model_validator(mode="after")
    def _plausible(self) -> "_CameraFile":
        matrix, wanted = self.camera_matrix, MODELS[self.distortion_model]
        if (matrix.rows, matrix.cols) != (3, 3):
            raise ValueError(f"camera_matrix is {matrix.rows} × {matrix.cols} instead of 3 × 3: correct the matrix")
        if min(matrix.data[0], matrix.data[4]) <= 0.0:
            raise ValueError("camera_matrix has a focal length that is not above 0: calibrate the camera again")
        if len(self.distortion_coefficients.data) != wanted:
            raise ValueError(
                f"distortion_coefficients has {len(self.distortion_coefficients.data)} values, but "
                f"{self.distortion_model} has {wanted}: correct the number of values"
            )
        return self


def read_intrinsics(path: Path) -> Intrinsics:
    """Read a camera.yaml.

    Args:
        path: File written by camera_calibration or ``servoloop camera calibrate``.

    Raises:
        CameraFileError: The file has errors. The message lists all errors with their line numbers.
    """
    file = load(path, _CameraFile, CameraFileError)
    distortion = file.distortion_coefficients.array().reshape(-1)
    return Intrinsics(file.camera_matrix.array(), distortion, file.image_width, file.image_height, file.camera_name)


def intrinsics_text(intrinsics: Intrinsics) -> str:
    """Return the content of a camera.yaml that ``read_intrinsics`` and ROS can read."""
    content = {
        "image_width": intrinsics.width,
        "image_height": intrinsics.height,
        "camera_name": intrinsics.name,
        "camera_matrix": _matrix(intrinsics.matrix),
        "distortion_model": intrinsics.distortion_model,
        "distortion_coefficients": _matrix(intrinsics.distortion[np.newaxis]),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(intrinsics.projection),
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)


def _matrix(values: NDArray[np.float64]) -> dict[str, Any]:
    rows, cols = values.shape
    return {"rows": rows, "cols": cols, "data": [float(value) for value in values.reshape(-1)]}


def check_size(intrinsics: Intrinsics, size: Sequence[int], source: str) -> None:
    """Check that images have the calibration resolution.

    Args:
        intrinsics: Calibration of the camera.
        size: Width and height of the images, in pixels.
        source: Name of the image source.

    Raises:
        CameraFileError: The resolutions differ.
    """
    if tuple(size) != intrinsics.size:
        raise CameraFileError(
            f"{source} delivers {size[0]} × {size[1]} pixels, but the calibration of {intrinsics.name} is for "
            f"{intrinsics.width} × {intrinsics.height}: calibrate at the camera's resolution, or change this resolution"
        )
