"""The intrinsics and their file, in the layout of camera_calibration."""

from pathlib import Path

import numpy as np
import pytest

from perception.intrinsics import Intrinsics, check_size, intrinsics_text, read_intrinsics
from perception.perception_errors import CameraFileError

FILE = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [601.5, 0.0, 318.2, 0.0, 602.25, 243.7, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.05, -0.11, 0.0011, -0.0007, 0.02]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [610.0, 0.0, 318.2, 0.0, 0.0, 611.0, 243.7, 0.0, 0.0, 0.0, 1.0, 0.0]
"""
"""A file of camera_calibration."""


def test_a_file_of_camera_calibration_is_read_and_survives_writing(tmp_path: Path) -> None:
    (tmp_path / "camera.yaml").write_text(FILE)
    read = read_intrinsics(tmp_path / "camera.yaml")
    assert read.size == (640, 480) and read.name == "narrow_stereo" and read.distortion_model == "plumb_bob"
    assert read.matrix[1, 2] == 243.7 and read.distortion[2] == 0.0011
    (tmp_path / "again.yaml").write_text(intrinsics_text(read))
    again = read_intrinsics(tmp_path / "again.yaml")
    assert np.array_equal(again.matrix, read.matrix) and np.array_equal(again.distortion, read.distortion)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("data: [601.5, 0.0,", "data: [601.5,", "camera.yaml:4: camera_matrix: has 8 values instead of 3 × 3"),
        ("data: [601.5,", "data: [-601.5,", "camera.yaml:1: camera_matrix has a focal length that is not above 0"),
        ("data: [601.5,", "data: [.nan,", "camera.yaml:7: camera_matrix.data.0: must be a finite number"),
        ("plumb_bob", "equidistant", "camera.yaml:8: distortion_model: must be 'plumb_bob' or 'rational_polynomial'"),
        ("image_width: 640\n", "", "image_width: is missing: add the key"),
        ("data: [0.05, -0.11, 0.0011, -0.0007, 0.02]", "data: [0.05]", "has 1 values instead of 1 × 5"),
    ],
)
def test_each_mistake_of_a_file_has_its_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in FILE
    (tmp_path / "camera.yaml").write_text(FILE.replace(old, new, 1))
    with pytest.raises(CameraFileError, match=message.replace("(", r"\(")):
        read_intrinsics(tmp_path / "camera.yaml")


def test_pictures_of_another_resolution_are_refused() -> None:
    with pytest.raises(CameraFileError, match=r"video0 delivers 1280 × 720 pixels, but .* is for 640 × 480"):
        check_size(Intrinsics.pinhole(600.0, 640, 480), (1280, 720), "video0")
