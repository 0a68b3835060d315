"""Conversions between pixels, rays and points of the plane."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.camera_view import CameraView, looking_at, pose_text, read_pose
from perception.intrinsics import Intrinsics
from perception.perception_errors import CameraFileError

LENS = Intrinsics(
    np.array([[600.0, 0.0, 318.0], [0.0, 605.0, 243.0], [0.0, 0.0, 1.0]]),
    np.array([0.06, -0.12, 0.001, -0.0007, 0.02]), 640, 480,
)  # fmt: skip
VIEW = CameraView(LENS, looking_at(np.array([-0.1, 0.05, 0.5]), np.array([0.25, 0.0, 0.0]), 0.02))


@given(st.floats(0, 639), st.floats(100, 479))
def test_a_point_of_the_plane_is_at_its_pixel(x: float, y: float) -> None:
    point = VIEW.on_plane(np.array([[x, y]]))
    assert point[0, 2] == pytest.approx(0.02)
    assert VIEW.pixels(point)[0] == pytest.approx([x, y], abs=0.01)


def test_the_top_of_the_picture_is_far_and_its_right_is_at_negative_y() -> None:
    middle, above, right = VIEW.on_plane(np.array([[320.0, 240.0], [320.0, 100.0], [500.0, 240.0]]))
    assert above[0] > middle[0] + 0.05 and right[1] < middle[1] - 0.05


def test_a_point_behind_the_camera_has_no_pixel() -> None:
    assert np.isnan(VIEW.pixels(np.array([[-2.0, 0.0, 2.0]]))).all()


def test_a_pose_survives_its_file_and_belongs_to_one_camera(tmp_path: Path) -> None:
    (tmp_path / "pose.yaml").write_text(pose_text(VIEW.pose))
    again = read_pose(tmp_path / "pose.yaml", "camera")
    assert again.rotation == pytest.approx(VIEW.pose.rotation, abs=1e-7)
    assert again.position_m == pytest.approx(VIEW.pose.position_m) and again.plane_height_m == 0.02
    with pytest.raises(CameraFileError, match="contains the pose of camera camera, but the intrinsics are"):
        read_pose(tmp_path / "pose.yaml", "left")


def test_a_camera_below_the_plane_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pose.yaml").write_text(pose_text(VIEW.pose).replace("plane_height_m: 0.02", "plane_height_m: 0.7"))
    with pytest.raises(CameraFileError, match=r"the camera at z = 0.5 m is not above the plane at 0.7 m"):
        read_pose(tmp_path / "pose.yaml", "camera")
