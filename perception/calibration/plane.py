"""Determine the pose of a camera above the table from one view of a board that lies on the table.

The position of the board in base_link is measured with a ruler. This is more accurate than a measurement with an arm
that has small servos. The repeatability of such servos, 1 to 2 degrees, would shift the result by centimeters.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from hal.types import FloatArray
from perception.calibration.board import BoardView
from perception.camera_view import CameraPose
from perception.intrinsics import Intrinsics, check_size
from perception.perception_errors import CalibrationRefused

MOST_ERROR_PX: Final = 1.5
"""Maximum RMS reprojection error, in pixels."""


@dataclass(frozen=True, slots=True)
class BoardPlace:
    """Position and direction of a board on the table, in the base_link frame."""

    x_m: float
    y_m: float
    """Position of the top left corner of the printed board, in m."""
    yaw_rad: float = 0.0
    """Direction of the board's upper edge from left to right, in rad: 0 is along x, and pi / 2 is along y."""
    height_m: float = 0.0
    """z of the board's surface, in m."""


@dataclass(frozen=True, slots=True, eq=False)
class PlaneReport:
    """Result of a plane calibration."""

    pose: CameraPose
    error_px: float
    """RMS distance between corners and their reprojections, in pixels."""


def calibrate_plane(view: BoardView, intrinsics: Intrinsics, place: BoardPlace) -> PlaneReport:
    """Determine the pose of a camera.

    Args:
        view: View of the board on the table.
        intrinsics: Intrinsics of the camera.
        place: Position and direction of the board.

    Raises:
        CalibrationRefused: The view does not match the intrinsics.
        CameraFileError: The resolutions of the view and the intrinsics differ.
    """
    check_size(intrinsics, view.size, "the camera")
    points = _in_base(view.corners_m, place)
    found, turn, shift = cv2.solvePnP(
        points - points[0], view.pixels, intrinsics.matrix, intrinsics.distortion, flags=cv2.SOLVEPNP_SQPNP
    )
    if found:
        turn, shift = cv2.solvePnPRefineLM(
            points - points[0], view.pixels, intrinsics.matrix, intrinsics.distortion, turn, shift
        )
    rotation = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64).T
    position_m = points[0] - rotation @ np.asarray(shift, dtype=np.float64).reshape(3)
    projected = cv2.projectPoints(points - points[0], turn, shift, intrinsics.matrix, intrinsics.distortion)[0]
    error_px = float(np.sqrt(((projected.reshape(-1, 2) - view.pixels) ** 2).sum(axis=1).mean()))
    if not found or not error_px <= MOST_ERROR_PX:
        raise CalibrationRefused(
            f"the board does not match the calibration of {intrinsics.name} (reprojection error {error_px:.1f} pixels)"
            ": calibrate the intrinsics of this camera first, and lay the board flat"
        )
    if position_m[2] <= place.height_m:
        raise CalibrationRefused("the camera is below the board: lay the board on the table printed side up")
    return PlaneReport(CameraPose(rotation, position_m, place.height_m, intrinsics.name), error_px)


def _in_base(corners_m: FloatArray, place: BoardPlace) -> FloatArray:
    """Return the points (n, 3) in base_link, in m, that correspond to board corners (n, 2)."""
    right = np.array([np.cos(place.yaw_rad), np.sin(place.yaw_rad), 0.0])
    down = np.array([np.sin(place.yaw_rad), -np.cos(place.yaw_rad), 0.0])
    origin = np.array([place.x_m, place.y_m, place.height_m])
    points: FloatArray = origin + corners_m[:, :1] * right + corners_m[:, 1:] * down
    return points
