"""Light that surfaces reflect to the camera, in compiled code. n is the number of points."""

from math import sin, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_backend.camera.skin import NO_SKIN
from sim_backend.compiled import compiled
from sim_backend.scene.rays import PLANE

FloatArray = NDArray[np.float64]

GLOSS: Final = 0.35
"""Brightness of the lamp's reflection on an apple."""
GLOSS_POWER: Final = 60.0
"""Exponent that determines the sharpness of a reflection."""
ABOVE: Final = 0.3
"""Fraction of the ambient light that comes from above."""
GRAIN: Final = 0.02
"""Variation of the table's brightness."""


def linear(rgb: FloatArray) -> FloatArray:
    """Convert sRGB colors from 0 to 1 to linear RGB."""
    colors: FloatArray = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return colors


@compiled
def albedo(colors: FloatArray, kinds: Any, geom: Any, point: FloatArray) -> FloatArray:
    """Return the color (n, 3) of points on geoms without an apple skin. The table has a faint grain."""
    found = np.empty((len(geom), 3))
    for n in range(len(geom)):
        grain = 1.0
        if kinds[geom[n]] == PLANE:
            x, y = point[n, 0], point[n, 1]
            grain += GRAIN * sin(310.0 * x + 4.0 * sin(47.0 * y)) * sin(23.0 * x - 11.0 * y)
        for i in range(3):
            found[n, i] = colors[geom[n], i] * grain
    return found


@compiled
def shade(
    color: FloatArray, kind: Any, normal: FloatArray, ray: FloatArray, lit: Any, lamp: tuple[FloatArray, float]
) -> FloatArray:
    """Return the radiance (n, 3) of points, relative to a fully lit white surface.

    ``lit`` (n,) specifies whether the lamp's light reaches each point. ``lamp`` contains the direction to the lamp and
    the ambient fraction.
    """
    toward, ambient = lamp
    found = np.empty((len(color), 3))
    for n in range(len(color)):
        light, gloss = ambient * (1.0 - ABOVE + ABOVE * normal[n, 2]), 0.0
        facing = normal[n, 0] * toward[0] + normal[n, 1] * toward[1] + normal[n, 2] * toward[2]
        if lit[n] and facing > 0.0:
            light += (1.0 - ambient) * facing
            if kind[n] != NO_SKIN:
                gloss = (1.0 - ambient) * GLOSS * _reflected(normal[n], ray[n], toward) ** GLOSS_POWER
        for i in range(3):
            found[n, i] = color[n, i] * light + gloss
    return found


@compiled
def _reflected(normal: FloatArray, ray: FloatArray, toward: FloatArray) -> float:
    """Return the cosine of the angle between a normal and the direction halfway between the eye and the lamp."""
    x, y, z = toward[0] - ray[0], toward[1] - ray[1], toward[2] - ray[2]
    cosine: float = (normal[0] * x + normal[1] * y + normal[2] * z) / sqrt(x * x + y * y + z * z)
    return max(0.0, cosine)
