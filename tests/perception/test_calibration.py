"""Calibration with views of a board that are warped, blurred and noisy."""

import re
import zlib

import cv2
import numpy as np
import pytest

from perception.calibration.board import Board, BoardDetector, BoardView, board_pdf, board_picture
from perception.calibration.lens import calibrate_lens
from perception.calibration.plane import BoardPlace, calibrate_plane
from perception.camera_view import CameraView, looking_at
from perception.frames import Picture
from perception.intrinsics import Intrinsics
from perception.perception_errors import CalibrationRefused

BOARD = Board()
DETECTOR = BoardDetector(BOARD)
LENS = Intrinsics(
    np.array([[612.0, 0.0, 326.0], [0.0, 609.0, 236.0], [0.0, 0.0, 1.0]]),
    np.array([0.08, -0.15, 0.001, -0.0008, 0.03]), 640, 480,
)  # fmt: skip
SQUARE_PX = 90


def seen(turn: np.ndarray, shift: np.ndarray, seed: int) -> Picture:
    """Return a picture of the board at a given pose in the camera frame, as seen through the lens."""
    x, y = np.meshgrid(np.arange(640.0), np.arange(480.0))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    flat = cv2.undistortPoints(pixels, LENS.matrix, LENS.distortion).reshape(-1, 2)
    rotation = cv2.Rodrigues(turn)[0]
    to_board = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], shift]))
    places = np.column_stack([flat, np.ones(len(flat))]) @ to_board.T
    scale = SQUARE_PX / BOARD.square_m
    on = (places[:, :2] / places[:, 2:] * scale - 0.5).astype(np.float32).reshape(480, 640, 2)
    print_ = cv2.GaussianBlur(board_picture(BOARD, SQUARE_PX), (0, 0), 1.0)
    gray = cv2.remap(print_, on[..., 0], on[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=190)
    noisy = cv2.GaussianBlur(gray, (0, 0), 0.7) * 0.8 + 20 + np.random.default_rng(seed).normal(0.0, 3.0, gray.shape)
    return np.repeat(noisy.clip(0, 255).astype(np.uint8)[..., np.newaxis], 3, axis=2)


def views(count: int, tilt_rad: float) -> list[BoardView]:
    """Return the views of the board in ``pictures``."""
    return [DETECTOR.view(picture) for picture in pictures(count, tilt_rad)]


def pictures(count: int, tilt_rad: float) -> list[Picture]:
    """Return pictures of a board that is tilted to all sides and appears in all parts of the picture."""
    rng = np.random.default_rng(3)
    found = []
    for number in range(count):
        angle = 2.4 * number
        turn = np.array([np.cos(angle), np.sin(angle), 0.0]) * tilt_rad + rng.normal(0.0, 0.02, 3)
        middle = np.array([0.07 * np.cos(1.7 * number), 0.05 * np.sin(1.7 * number), 0.38 + 0.03 * (number % 3)])
        half = np.array([*BOARD.size_m, 0.0]) / 2
        shift = middle - cv2.Rodrigues(turn)[0] @ half
        found.append(seen(turn, shift, number))
    return found


def test_fifteen_views_recover_the_lens() -> None:
    report = calibrate_lens(views(15, 0.45), "left")
    focal = report.intrinsics.matrix[[0, 1], [0, 1]]
    assert focal == pytest.approx([612.0, 609.0], rel=0.005)
    assert report.intrinsics.matrix[:2, 2] == pytest.approx([326.0, 236.0], abs=3.0)
    assert report.error_px < 0.4 and len(report.view_errors_px) == 15
    assert report.intrinsics.name == "left"


def test_a_board_that_is_seen_from_one_side_only_is_refused() -> None:
    with pytest.raises(CalibrationRefused, match="all views show the board from the same side"):
        calibrate_lens(views(9, 0.0))


@pytest.mark.parametrize("rows", [1, 2])
def test_a_single_row_of_corners_is_no_view(rows: int) -> None:
    picture = seen(np.zeros(3), np.array([-0.13, -0.08, 0.4]), 1)
    whole = DETECTOR.view(picture)
    end = whole.pixels[whole.corners_m[:, 1] < (rows + 0.5) * BOARD.square_m, 1].max() + 46.0
    picture[int(end) :] = 190
    if rows == 2:
        assert len(DETECTOR.view(picture).pixels) == 16
        return
    with pytest.raises(CalibrationRefused, match="8 corners of the board, but almost all of them are on one line"):
        DETECTOR.view(picture)


def test_few_views_are_refused() -> None:
    with pytest.raises(CalibrationRefused, match="3 views of the board are not enough: take at least 8"):
        calibrate_lens(views(3, 0.45))


def test_a_picture_without_the_board_is_refused() -> None:
    with pytest.raises(CalibrationRefused, match="shows 0 corners of the board"):
        DETECTOR.view(np.full((480, 640, 3), 128, np.uint8))


@pytest.mark.parametrize("yaw_rad", [-np.pi / 2, 0.3])
def test_one_view_gives_points_of_the_plane_within_2_mm(yaw_rad: float) -> None:
    place = BoardPlace(0.2, 0.12, yaw_rad, 0.01)
    right, down = np.array([np.cos(yaw_rad), np.sin(yaw_rad)]), np.array([np.sin(yaw_rad), -np.cos(yaw_rad)])
    middle = np.array([0.2, 0.12]) + right * BOARD.size_m[0] / 2 + down * BOARD.size_m[1] / 2
    pose = looking_at(np.array([middle[0] - 0.2, middle[1], 0.35]), np.array([*middle, 0.01]), 0.01)
    base_to_camera = pose.rotation.T
    axes = base_to_camera @ np.column_stack([[*right, 0.0], [*down, 0.0], [0.0, 0.0, -1.0]])
    shift = base_to_camera @ (np.array([0.2, 0.12, 0.01]) - pose.position_m)
    picture = seen(cv2.Rodrigues(axes)[0].reshape(3), shift, 1)
    report = calibrate_plane(DETECTOR.view(picture), LENS, place)
    pixels = np.array([[120.0, 120.0], [520.0, 130.0], [320.0, 240.0], [150.0, 400.0], [500.0, 420.0]])
    wanted, got = (CameraView(LENS, one).on_plane(pixels) for one in (pose, report.pose))
    assert np.abs(got - wanted).max() < 0.002
    assert report.error_px < 0.5


def test_the_lens_of_another_camera_is_refused() -> None:
    [view] = views(1, 0.5)
    with pytest.raises(CalibrationRefused, match="does not match the calibration of right"):
        calibrate_plane(view, Intrinsics.pinhole(1500.0, 640, 480, "right"), BoardPlace(0.1, 0.1))


def test_the_page_has_the_board_in_its_true_size() -> None:
    page = board_pdf(BOARD)
    width, height = re.search(rb"q ([\d.]+) 0 0 ([\d.]+)", page).groups()
    assert float(width) * 25.4 / 72 == pytest.approx(270.0, abs=0.01)
    assert float(height) * 25.4 / 72 == pytest.approx(180.0, abs=0.01)
    start = page.index(b"stream\n", page.index(b"/Width 1080")) + 7
    picture = np.frombuffer(zlib.decompressobj().decompress(page[start:]), np.uint8).reshape(720, 1080)
    framed = cv2.copyMakeBorder(picture, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    assert len(DETECTOR.view(np.repeat(framed[..., np.newaxis], 3, axis=2)).pixels) == 8 * 5
    for number, offset in enumerate(re.findall(rb"(\d{10}) 00000 n", page), start=1):
        assert page[int(offset) :].startswith(b"%d 0 obj" % number)


def test_a_board_that_does_not_fit_on_the_page_is_refused() -> None:
    with pytest.raises(CalibrationRefused, match="360 × 240 mm does not fit on A4"):
        board_pdf(Board(square_m=0.04))
