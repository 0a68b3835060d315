"""Apple skin: color and type of each point, in compiled code.

Colors are the fractions of light reflected, in linear RGB.
"""

from math import cos, exp, sin, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backend.apples.apple import Apple
from sim_backend.compiled import compiled

FloatArray = NDArray[np.float64]

NO_SKIN: Final = 0
GREEN: Final = 1
RED: Final = 2
DEFECT: Final = 3
"""Types of skin points. A spot is treated as a defect, whether it is brown or dark."""
GREENS: Final = np.array([[0.24, 0.40, 0.05], [0.46, 0.50, 0.09]])
REDS: Final = np.array([[0.30, 0.022, 0.025], [0.50, 0.045, 0.035]])
BROWNS: Final = np.array([[0.115, 0.062, 0.024], [0.19, 0.105, 0.042]])
DARKS: Final = np.array([[0.018, 0.012, 0.009], [0.04, 0.027, 0.02]])
"""Lower and upper end of each color's range."""
WAVES: Final = 12
"""Number of waves that form the pattern."""
WAVE_RAD: Final = (1.5, 9.0)
"""Range of wave numbers, in radians per apple radius."""
BLUSH_EDGE: Final = 0.06
"""Half the width of the transition from green to red, in units of the pattern."""
SPOT_EDGE: Final = 0.012
"""Half the width of a spot's edge, in rad."""
FRAYED: Final = 0.12
"""Amount by which the pattern shifts the edge of a spot, as a fraction of its radius."""
MOTTLED: Final = 0.1
"""Variation of the skin's brightness."""
SAMPLES: Final = 4000
"""Number of random points on the skin from which ``Skin.level``, the threshold between green and red, is computed."""


class Skin(NamedTuple):
    """Arrays that describe one skin, with w waves and s spots."""

    green: FloatArray
    """Color of the green part of the skin, shape (3,)."""
    red: FloatArray
    """Color of the red part of the skin, shape (3,)."""
    side: FloatArray
    """Direction of the side that faced the sun and turns red first, shape (3,)."""
    waves: FloatArray
    """Shape (w, 5): wave vector, phase and amplitude."""
    level: float
    """Pattern value above which the skin is red."""
    spots: FloatArray
    """Shape (s, 7): direction, radius (rad) and color."""


def skin_of(apple: Apple) -> Skin:
    """Return the skin of an apple."""
    random = np.random.default_rng((apple.seed, 1))
    vectors = random.normal(size=(WAVES + 1, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    numbers = random.uniform(*WAVE_RAD, WAVES)
    waves = np.column_stack([vectors[1:] * numbers[:, None], random.uniform(0.0, 2.0 * np.pi, WAVES), 0.5 / numbers])
    green, red = _between(GREENS, random), _between(REDS, random)
    spots = [
        [*spot.direction, spot.radius_rad, *_between(DARKS if spot.dark else BROWNS, random)] for spot in apple.spots
    ]
    skin = Skin(green, red, vectors[0].copy(), waves, 0.0, np.array(spots).reshape(-1, 7))
    points = random.normal(size=(SAMPLES, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return skin._replace(level=float(np.quantile(_patterns(skin, points), 1.0 - apple.red_share)))


def _between(ends: FloatArray, random: np.random.Generator) -> FloatArray:
    color: FloatArray = ends[0] + random.uniform() * (ends[1] - ends[0])
    return color


@compiled
def _pattern(skin: Skin, x: float, y: float, z: float) -> float:
    """Return the pattern value in one direction, which is given as a unit vector."""
    value: float = 0.7 * (skin.side[0] * x + skin.side[1] * y + skin.side[2] * z)
    for wave in skin.waves:
        value += wave[4] * sin(wave[0] * x + wave[1] * y + wave[2] * z + wave[3])
    return value


@compiled
def _patterns(skin: Skin, directions: FloatArray) -> FloatArray:
    """Return the pattern values in directions (n, 3)."""
    values = np.empty(len(directions))
    for n in range(len(directions)):
        values[n] = _pattern(skin, directions[n, 0], directions[n, 1], directions[n, 2])
    return values


@compiled
def _share(value: float, edge: float) -> float:
    """Return the mixing ratio: 0.5 at a distance of zero, and almost 0 or 1 at a distance of twice the edge width."""
    return 1.0 / (1.0 + exp(-min(max(2.0 * value / edge, -40.0), 40.0)))


@compiled
def paint(skin: Skin, points: FloatArray, color: FloatArray, kind: Any) -> None:
    """Store the color (n, 3) and the type (n,) of points (n, 3), which are given in the apple's frame, in units of its
    radii."""
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        length = sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        pattern = _pattern(skin, x, y, z)
        red = _share(pattern - skin.level, BLUSH_EDGE)
        kind[n] = RED if red > 0.5 else GREEN
        shade = 1.0 + MOTTLED * sin(7.0 * pattern + 3.0 * z)
        for i in range(3):
            color[n, i] = shade * (skin.green[i] + red * (skin.red[i] - skin.green[i]))
        for spot in skin.spots:
            # The chord is almost equal to the angle, and is faster to compute.
            away = sqrt((x - spot[0]) ** 2 + (y - spot[1]) ** 2 + (z - spot[2]) ** 2)
            radius = spot[3] * (1.0 + FRAYED * cos(11.0 * pattern))
            share = _share(radius - away, SPOT_EDGE)
            if share > 0.5:
                kind[n] = DEFECT
            for i in range(3):
                color[n, i] += share * (spot[4 + i] - color[n, i])
