"""Convert images to linear colors relative to the table color.

All grading features are ratios to the table color, so the brightness and the color of the light do not affect them.
"""

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.frames import Picture
from perception.perception_errors import PictureRefused

Pixels = NDArray[np.float32]
"""Linear RGB (height, width, 3)."""

DARKEST: Final = 0.01
"""Minimum linear brightness of the bright pixels of an image, as a fraction of white."""
BRIGHT_PERCENT: Final = 90.0
"""Brightness percentile that is compared with ``DARKEST``."""
CLIPPED: Final = 250
"""Minimum value at which a pixel is considered overexposed."""
MOST_CLIPPED: Final = 0.25
"""Maximum fraction of overexposed pixels in an image."""
STEP: Final = 3
"""Step between the pixels, in both directions, that are used to estimate the table color."""
SPAN: Final = 2.0
BIN: Final = 0.04
"""Range and bin width of the histogram of log ratios of two color channels."""
PEAK: Final = 0.08
"""Maximum distance from the histogram's peak at which a pixel is considered part of the table."""


def linear_rgb(picture: Picture) -> Pixels:
    """Convert an sRGB image to linear RGB (height, width, 3)."""
    share = np.arange(256, dtype=np.float64) / 255.0
    curve = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return cv2.LUT(picture, curve.astype(np.float32))  # type: ignore[return-value]


def relative_to_table(picture: Picture, region: NDArray[np.bool_] | None = None) -> Pixels:
    """Convert an sRGB image to linear RGB (height, width, 3), in units of the table color.

    Args:
        picture: The image.
        region: Mask (height, width) of the table's pixels, or None for all pixels.

    Raises:
        PictureRefused: The image is black or overexposed.
    """
    linear: Pixels = np.asarray(cv2.GaussianBlur(linear_rgb(picture), (3, 3), 0.7), dtype=np.float32)
    pixels = linear[::STEP, ::STEP].reshape(-1, 3)
    values = picture[::STEP, ::STEP].reshape(-1, 3)
    if region is not None and (part := region[::STEP, ::STEP].reshape(-1)).any():
        pixels, values = pixels[part], values[part]
    _check_exposure(pixels, values)
    relative: Pixels = linear / table_color(pixels[_largest(values) < CLIPPED])
    return relative


def _largest(values: NDArray[Any]) -> NDArray[Any]:
    """Return the largest value (n,) of each pixel (n, 3). This is much faster than NumPy's ``max`` over an axis of
    three values."""
    largest: NDArray[Any] = np.maximum(np.maximum(values[:, 0], values[:, 1]), values[:, 2])
    return largest


def table_color(pixels: Pixels) -> NDArray[np.float32]:
    """Return the most frequent color (3,) among pixels (n, 3), in linear RGB. The most frequent color is the color of
    the table."""
    lit = pixels[-_largest(-pixels) > 0.5 * DARKEST]
    if not len(lit):
        raise PictureRefused("the image has no well exposed pixel: correct the exposure of the camera")
    ratios = np.log(lit[:, [0, 2]] / lit[:, 1:2])
    edges = np.arange(-SPAN, SPAN + BIN, BIN)
    # Apples are saturated and have many shades, so the table forms the peak even if apples cover half of the image.
    counts = np.histogram2d(ratios[:, 0], ratios[:, 1], bins=(edges, edges))[0]
    smooth = cv2.GaussianBlur(counts, (5, 5), 1.0)
    peak = np.array(np.unravel_index(int(smooth.argmax()), smooth.shape))
    off = np.abs(ratios - (edges[peak] + 0.5 * BIN))
    near = np.maximum(off[:, 0], off[:, 1]) < PEAK
    table = lit[near] if near.any() else lit
    color: NDArray[np.float32] = np.median(table, axis=0).astype(np.float32)
    return color


def _check_exposure(pixels: Pixels, values: NDArray[np.uint8]) -> None:
    brightness = float(np.percentile(_largest(pixels), BRIGHT_PERCENT))
    if brightness < DARKEST:
        raise PictureRefused(
            f"the image is almost black ({100.0 * brightness:.1f} % of white): remove the lens cap, or switch on a lamp"
        )
    clipped = float((_largest(values) >= CLIPPED).mean())
    if clipped > MOST_CLIPPED:
        raise PictureRefused(
            f"{100.0 * clipped:.0f} % of the image is overexposed: lower the exposure of the camera, or dim the lamp"
        )
