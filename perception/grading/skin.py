"""Find the red pixels and the defects in an apple's skin.

The brightness of a pixel is compared with healthy skin at the same position on the sphere, because the side facing away
from the lamp is dark but healthy. A defect is darker than healthy skin and has a color that does not occur in healthy
skin. A shadow of another object is therefore not a defect.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray

Flags = NDArray[np.bool_]

RED_HUE: Final = 0.6
"""Maximum hue of red skin, as (G - B) / (R - B) in linear light: 0 is red, and 1 is yellow."""
DARKER: Final = -0.3
"""Maximum log brightness of a defect, relative to the darkest healthy skin at the same position."""
HALF: Final = -0.45
"""Maximum log relative brightness of a pixel that is next to a defect and mixes the colors of the defect and healthy
skin."""
BLACK: Final = -1.9
"""Log relative brightness below which a pixel of any color is a defect."""
BROWN: Final = (0.28, 0.74)
"""Range of G / R for brown pixels. Red skin has less green, and yellow or green skin has more."""
BROWN_BLUE: Final = 0.14
"""Smallest B / R of brown. The transition from red to green skin has less blue."""
MUCH_DARKER: Final = -0.6
DARK_BROWN_BLUE: Final = 0.06
"""Maximum log relative brightness and minimum B / R of a brown with little blue. The transition from red to green skin
has this color, but is not as dark."""
GRAY_BLUE: Final = 0.33
GRAY_GREEN: Final = 0.55
"""Minimum B / R and G / R of gray and black."""
NOT_PALE_RED: Final = 1.25
"""Smallest G / B of brown. Where image compression mixes red skin with the gray of the table, G and B are equal."""
MOSTLY: Final = 0.6
"""Minimum fraction of brown pixels at which the whole apple is considered either yellow or rotten."""
YELLOW: Final = 0.22
"""Minimum median brightness at which such an apple is considered yellow."""
LEAST_SOUND: Final = 0.4
"""Minimum fraction of the red (or green) pixels that are not brown. If the fraction is smaller, the brightness of these
pixels is not used."""
ROUNDS: Final = 6
MOST_POINTS: Final = 800
"""Minimum number of sampled pixels for estimating the brightness of healthy skin. If there are fewer pixels, all of
them are used."""
SPREAD: Final = 0.12
"""Spread of the log brightness of healthy skin."""
CHROMA_BIN: Final = 0.15
"""Bin width for the colors of healthy skin, in log ratios."""
COMMON: Final = 0.02
"""Minimum fraction of the skin at which a color is considered a color of healthy skin."""
RIM_PX: Final = (1.2, 2.5)
"""Minimum and maximum width of the rim that is not graded, in pixels, because its colors mix the apple and the table.
The mixture is wide in compressed images, such as those from USB cameras, because their color has a lower resolution."""
RIM: Final = 0.08
"""Width of the rim between these limits, as a fraction of the apple's radius."""
RING: Final = 0.08
"""Width of the ring inside the rim, as a difference of squared distances relative to the radius. The ring's pixels also
represent the rim, so they have a higher weight."""
DIMMEST: Final = 1e-3
"""Minimum brightness, relative to the table."""


@dataclass(frozen=True, slots=True)
class VisibleSkin:
    """The visible skin of one apple."""

    red_ratio: float
    """Fraction of the skin that is red and not defective."""
    defect_score: float
    """Fraction of the skin that is defective."""


def rim_px(radius_px: float) -> float:
    """Return the width of the apple's rim that is not graded, in pixels."""
    return min(max(RIM * radius_px, RIM_PX[0]), RIM_PX[1])


def judge(colors: FloatArray, places: FloatArray, area: Flags) -> tuple[Flags, Flags]:
    """Return which pixels are red and which are defects.

    Args:
        colors: Linear RGB (n, 3) of the pixels, relative to a white surface.
        places: Positions (n, 2) of the pixels relative to the outline, which has a radius of 1.
        area: Mask that marks the positions of the n pixels in a part (height, width) of the image.
    """
    red, green, blue = np.maximum(colors, DIMMEST).T
    is_red = (green - blue) < RED_HUE * np.maximum(red - blue, DIMMEST)
    brightness = np.log(np.maximum(np.maximum(red, green), blue))
    ratio_green, ratio_blue = green / red, blue / red
    brown = _brown(ratio_green, ratio_blue, brightness)
    relative = brightness - _sound(brightness, places, is_red, brown)
    skin_colors = _common(np.log(ratio_green), np.log(ratio_blue), (relative > -0.2) & ~brown)
    dark_brown = (relative < MUCH_DARKER) & (ratio_green > BROWN[0]) & (ratio_green < BROWN[1])
    dark_brown &= ratio_blue > DARK_BROWN_BLUE
    defect = (relative < BLACK) | (((relative < DARKER) & brown | dark_brown) & ~skin_colors)
    defect = defect | (_beside(defect, area) & (relative < HALF))
    return is_red & ~defect, defect


def _beside(defect: Flags, area: Flags) -> Flags:
    """Return which pixels are part of a defect or next to one."""
    mask = np.zeros(area.shape, np.uint8)
    mask[area] = defect
    beside: Flags = cv2.dilate(mask, np.ones((3, 3), np.uint8))[area] > 0
    return beside


def skin_of(colors: FloatArray, places: FloatArray, area: Flags) -> VisibleSkin:
    """Return the fractions of red pixels and of defects. The arguments are the same as in ``judge``."""
    red, defect = judge(colors, places, area)
    away = (places * places).sum(axis=1)
    ring = float(away.max()) - RING
    weights = np.where(away > ring, (1.0 - ring) / RING, 1.0)
    total = float(weights.sum())
    return VisibleSkin(float(weights @ red) / total, float(weights @ defect) / total)


def _brown(green: FloatArray, blue: FloatArray, brightness: FloatArray) -> Flags:
    """Return which pixels have the color of a defect, given G / R, B / R and log brightness (n,)."""
    brown: Flags = (green > BROWN[0]) & (green < BROWN[1]) & (blue > BROWN_BLUE) & (green > NOT_PALE_RED * blue)
    brown |= (blue > GRAY_BLUE) & (green > GRAY_GREEN)
    if brown.mean() > MOSTLY and np.median(brightness[brown]) > np.log(YELLOW):
        brown[:] = False
    return brown


def _sound(brightness: FloatArray, places: FloatArray, is_red: Flags, brown: Flags) -> FloatArray:
    """Return the log brightness (n,) that the darkest healthy skin would have at each pixel.

    The estimate is a smooth function of the position, with one level for red skin and one for green skin. Darker pixels
    have little weight, because they are spots or in a shadow.
    """
    x, y = places.T
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    shapes = np.column_stack([is_red, ~is_red, x, y, z, x * x, x * y, y * y]).astype(np.float64)
    step = max(1, len(brightness) // MOST_POINTS)
    sample, wanted = shapes[::step], brightness[::step]
    weights = np.where(brown[::step], 0.05, 1.0)
    fit: FloatArray = np.zeros(shapes.shape[1])
    ridge = 1e-3 * len(sample) * np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    for _ in range(ROUNDS):
        weighted = sample * weights[:, np.newaxis]
        fit = np.asarray(np.linalg.lstsq(weighted.T @ sample + ridge, weighted.T @ wanted, rcond=None)[0])
        left = wanted - sample @ fit
        weights = np.where(left > 0.0, 1.0, 1.0 / (1.0 + (left / SPREAD) ** 2) ** 2)
        weights = weights * np.where(brown[::step] & (left < -SPREAD), 0.05, 1.0)
    levels = [level for level, kind in ((fit[0], is_red), (fit[1], ~is_red)) if _is_skin(kind, brown)]
    smooth: FloatArray = shapes[:, 2:] @ fit[2:] + (min(levels) if levels else max(fit[0], fit[1]))
    return smooth


def _is_skin(kind: Flags, brown: Flags) -> bool:
    """Return whether pixels of one color, red or green, are skin. If most of these pixels are brown, they are a spot
    and its edge."""
    sound = int((kind & ~brown).sum())
    return sound > COMMON * len(kind) and sound > LEAST_SOUND * int(kind.sum())


def _common(green: FloatArray, blue: FloatArray, sound: Flags) -> Flags:
    """Return which pixels have a color that is common among healthy pixels. The colors are logarithms of G / R and B /
    R (n,)."""
    if not sound.any():
        return np.zeros(len(green), dtype=bool)
    bins = np.clip(np.column_stack([green, blue]) / CHROMA_BIN, -40, 40).round().astype(int) + 40
    counts = np.zeros((81, 81))
    np.add.at(counts, tuple(bins[sound].T), 1.0)
    common: Flags = (counts > COMMON * sound.sum())[bins[:, 0], bins[:, 1]]
    return common
