"""Draw and detect a ChArUco board, which is a chessboard with a marker in each white square."""

import zlib
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray
from perception.frames import Picture
from perception.perception_errors import CalibrationRefused

MARKERS: Final = {50: cv2.aruco.DICT_5X5_50, 100: cv2.aruco.DICT_5X5_100}
"""Marker dictionaries, keyed by the number of markers that they contain. The largest board needs 70 markers."""
MARKER_SHARE: Final = 0.74
"""Side length of a marker, as a fraction of the side length of a square."""
LEAST_CORNERS: Final = 8
"""Minimum number of corners that a view must contain."""
LEAST_WIDTH: Final = 0.45
"""Minimum spread of a view's corners across their longest direction, as a fraction of a square. Two rows of corners
have a spread of 0.5, and one row has 0. One row with a few additional corners does not determine the board's pose."""
A4_M: Final = (0.297, 0.210)
"""Width and height of the page, in m."""
POINT_M: Final = 0.0254 / 72.0
"""PDF length unit, in m."""


@dataclass(frozen=True, slots=True)
class Board:
    """Dimensions of a board. The default board fills an A4 page."""

    columns: int = 9
    rows: int = 6
    square_m: float = 0.03
    """Side length of a square, in m, as measured on the printed board."""

    def detector_board(self) -> Any:
        """Return the board as an OpenCV object."""
        needed = self.columns * self.rows // 2
        dictionary = cv2.aruco.getPredefinedDictionary(next(MARKERS[count] for count in MARKERS if count >= needed))
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, MARKER_SHARE * self.square_m, dictionary)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height, in m."""
        return self.columns * self.square_m, self.rows * self.square_m


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """The corners of a board in one image."""

    corners_m: FloatArray
    """Corners (n, 2) on the board, in m: x to the right and y down from its top left corner."""
    pixels: FloatArray
    """Pixel coordinates (n, 2) of these corners."""
    size: tuple[int, int]
    """Width and height of the image, in pixels."""


class BoardDetector:
    """Detector that finds a board in images."""

    def __init__(self, board: Board) -> None:
        self._board = board.detector_board()
        self._detector = cv2.aruco.CharucoDetector(self._board)

    def view(self, picture: Picture) -> BoardView:
        """Find the board in an RGB image (height, width, 3).

        Raises:
            CalibrationRefused: The image does not show enough of the board.
        """
        gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        corners, ids, _, _ = self._detector.detectBoard(gray)
        count = 0 if ids is None else len(ids)
        if count < LEAST_CORNERS:
            raise CalibrationRefused(
                f"the image shows {count} corners of the board, but at least {LEAST_CORNERS} are needed: bring the "
                f"whole board into the image, flat and without reflections"
            )
        points, pixels = self._board.matchImagePoints(corners, ids)
        flat = np.asarray(points, dtype=np.float64).reshape(-1, 3)[:, :2]
        if _width_m(flat) < LEAST_WIDTH * self._board.getSquareLength():
            raise CalibrationRefused(
                f"the image shows {count} corners of the board, but almost all of them are on one line: bring the "
                "whole board into the image"
            )
        return BoardView(
            flat, np.asarray(pixels, dtype=np.float64).reshape(-1, 2), (picture.shape[1], picture.shape[0])
        )


def _width_m(corners_m: FloatArray) -> float:
    """Return the standard deviation of corners (n, 2) across their longest direction, in m. The result is 0 if the
    corners are on a line."""
    around = corners_m - corners_m.mean(axis=0)
    return float(np.linalg.svd(around, compute_uv=False)[-1] / np.sqrt(len(around)))


def board_picture(board: Board, square_px: int = 120) -> NDArray[np.uint8]:
    """Return the board as a gray image (rows * square_px, columns * square_px), without a margin."""
    size = (board.columns * square_px, board.rows * square_px)
    return np.asarray(board.detector_board().generateImage(size, marginSize=0, borderBits=1), dtype=np.uint8)


def board_pdf(board: Board) -> bytes:
    """Return an A4 page with the board at its true size.

    Raises:
        CalibrationRefused: The board does not fit on the page.
    """
    width_m, height_m = board.size_m
    if width_m > A4_M[0] - 0.01 or height_m > A4_M[1] - 0.02:
        raise CalibrationRefused(
            f"a board of {1000 * width_m:.0f} × {1000 * height_m:.0f} mm does not fit on A4 with a margin of 5 mm: "
            "choose fewer or smaller squares, or write a PNG"
        )
    picture = board_picture(board)
    data = zlib.compress(picture.tobytes(), 9)
    page = [length / POINT_M for length in A4_M]
    width, height = width_m / POINT_M, height_m / POINT_M
    left, bottom = 0.5 * (page[0] - width), 0.5 * (page[1] - height) + 8.0
    label = f"Print at 100 %. A square must measure {1000 * board.square_m:g} mm. Glue the page to a flat plate."
    content = (
        f"q {width:.4f} 0 0 {height:.4f} {left:.4f} {bottom:.4f} cm /B Do Q "
        f"BT /F 9 Tf {left:.1f} {bottom - 14.0:.1f} Td ({label}) Tj ET"
    ).encode()
    rows, columns = picture.shape
    return _pdf(
        (
            b"<< /Type /Catalog /Pages 2 0 R >>",
            b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {page[0]:.2f} {page[1]:.2f}] /Contents 4 0 R "
            "/Resources << /XObject << /B 5 0 R >> /Font << /F 6 0 R >> >> >>".encode(),
            b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
            b"<< /Type /XObject /Subtype /Image /Width %d /Height %d /ColorSpace /DeviceGray /BitsPerComponent 8 "
            b"/Filter /FlateDecode /Length %d >>\nstream\n%s\nendstream" % (columns, rows, len(data), data),
            b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        )
    )


def _pdf(objects: tuple[bytes, ...]) -> bytes:
    """Return a PDF file with the given objects. The first object is the catalog."""
    text, offsets = b"%PDF-1.4\n", []
    for number, content in enumerate(objects, start=1):
        offsets.append(len(text))
        text += b"%d 0 obj\n%s\nendobj\n" % (number, content)
    table = b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    count = len(objects) + 1
    head = b"xref\n0 %d\n0000000000 65535 f \n%s" % (count, table)
    return text + head + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (count, len(text))
