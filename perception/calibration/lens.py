"""Calibrate the intrinsics of a camera from several views of a board."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from hal.types import FloatArray
from perception.calibration.board import BoardView
from perception.intrinsics import Intrinsics
from perception.perception_errors import CalibrationRefused

LEAST_VIEWS: Final = 8
LEAST_TILT_RAD: Final = 0.26
"""Minimum angle between the directions from which the views show the board, in rad. A smaller spread does not determine
the lens parameters.
"""
LEAST_COVERED: Final = 0.3
"""Minimum fraction of the image that the corners of all views together must cover."""
MOST_ERROR_PX: Final = 1.0
"""Maximum RMS reprojection error, in pixels. With sharp images, the error is about 0.2 pixels."""
CELLS: Final = 6
"""The image is divided into 6 × 6 cells to measure how much of the image the views cover."""


@dataclass(frozen=True, slots=True, eq=False)
class LensReport:
    """Result of a calibration."""

    intrinsics: Intrinsics
    error_px: float
    """RMS distance between corners and their reprojections, in pixels."""
    view_errors_px: tuple[float, ...]
    """RMS reprojection error of each view, in pixels."""
    tilt_rad: float
    """Maximum angle between the directions from which two views show the board, in rad."""
    covered: float
    """Fraction of the image that the corners of all views together cover."""


def calibrate_lens(views: Sequence[BoardView], name: str = "camera") -> LensReport:
    """Calibrate a camera.

    Args:
        views: At least ``LEAST_VIEWS`` views of one board, from different directions.
        name: Name of the camera.

    Raises:
        CalibrationRefused: The views do not determine the intrinsics, or are inconsistent.
    """
    if len(views) < LEAST_VIEWS:
        raise CalibrationRefused(
            f"{len(views)} views of the board are not enough: take at least {LEAST_VIEWS} from different sides"
        )
    sizes = {view.size for view in views}
    if len(sizes) > 1:
        listed = " and ".join(f"{width} × {height}" for width, height in sorted(sizes))
        raise CalibrationRefused(f"the views have different sizes ({listed}): take all of them at one resolution")
    points = [np.pad(view.corners_m, ((0, 0), (0, 1))).astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    size = views[0].size
    result = cv2.calibrateCamera(points, pixels, size, None, None)
    error_px, matrix, distortion, turns = result[:4]
    tilt_rad, covered = _tilt_rad([np.asarray(turn, dtype=np.float64) for turn in turns]), _covered(views)
    _check(tilt_rad, covered, float(error_px))
    intrinsics = Intrinsics(
        np.asarray(matrix, dtype=np.float64), np.asarray(distortion, dtype=np.float64).reshape(-1)[:5], *size, name
    )
    errors = tuple(
        _error_px(view, intrinsics, turn, shift) for view, turn, shift in zip(views, result[3], result[4], strict=True)
    )
    return LensReport(intrinsics, float(error_px), errors, tilt_rad, covered)


def _check(tilt_rad: float, covered: float, error_px: float) -> None:
    if tilt_rad < LEAST_TILT_RAD:
        raise CalibrationRefused(
            f"all views show the board from the same side (within {np.degrees(tilt_rad):.0f}°), which does not "
            "determine the focal length: tilt the board by 20° to 40° to each side"
        )
    if covered < LEAST_COVERED:
        raise CalibrationRefused(
            f"the views cover only {100 * covered:.0f} % of the image: move the board to all corners of the image"
        )
    if not error_px <= MOST_ERROR_PX:
        raise CalibrationRefused(
            f"the reprojection error is {error_px:.2f} pixels: check that the board is flat and that the size of its "
            "squares is right, and take sharp images"
        )


def _tilt_rad(turns: Sequence[FloatArray]) -> float:
    """Return the largest angle between the normals of boards with the given rotation vectors (3, 1)."""
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    return float(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0)))


def _covered(views: Sequence[BoardView]) -> float:
    cells = {
        tuple(cell)
        for view in views
        for cell in (view.pixels * CELLS / np.array(view.size)).astype(int).clip(0, CELLS - 1).tolist()
    }
    return len(cells) / CELLS**2


def _error_px(view: BoardView, intrinsics: Intrinsics, turn: object, shift: object) -> float:
    points = np.pad(view.corners_m, ((0, 0), (0, 1)))
    turned, shifted = np.asarray(turn, dtype=np.float64), np.asarray(shift, dtype=np.float64)
    projected = cv2.projectPoints(points, turned, shifted, intrinsics.matrix, intrinsics.distortion)[0].reshape(-1, 2)
    return float(np.sqrt(((projected - view.pixels) ** 2).sum(axis=1).mean()))
