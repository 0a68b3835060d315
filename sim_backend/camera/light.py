"""Lighting of a scene: brightness, color and direction."""

from dataclasses import dataclass
from math import cos, pi, radians, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

TEMPERATURES_K: Final = (1700.0, 25000.0)
"""Temperature range in which the color of a black body is approximated, in kelvins."""
TO_RGB: Final = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
"""Conversion from CIE XYZ to linear sRGB."""


@dataclass(frozen=True, slots=True)
class Light:
    """A distant lamp that casts sharp shadows, and ambient light from all sides."""

    toward: tuple[float, float, float] = (0.35, -0.45, 0.82)
    """Direction from the scene to the lamp, of any length."""
    illuminance_lux: float = 500.0
    temperature_k: float = 5500.0
    """Color temperature. A light bulb has a color temperature of 2700 K, daylight 5500 K and shade 7500 K."""
    ambient: float = 0.45
    """Fraction of the light that comes from all sides and reaches into the shadows, from 0 to 1."""

    @property
    def direction(self) -> FloatArray:
        """Unit vector (3,) toward the lamp."""
        toward = np.array(self.toward, dtype=float)
        unit: FloatArray = toward / np.linalg.norm(toward)
        return unit


def draw_light(seed: int) -> Light:
    """Return random lighting, as in a room with lamps or windows. The same seed returns the same light."""
    random = np.random.default_rng((seed, 2))
    turn, height = random.uniform(-pi, pi), random.uniform(radians(40.0), radians(80.0))
    toward = (cos(height) * cos(turn), cos(height) * sin(turn), sin(height))
    illuminance_lux = float(np.exp(random.uniform(np.log(150.0), np.log(2000.0))))
    return Light(toward, illuminance_lux, random.uniform(3000.0, 7500.0), random.uniform(0.35, 0.7))


def rgb_of_temperature(temperature_k: float) -> FloatArray:
    """Return the linear RGB color (3,) of a black body, with luminance 1. The temperature is limited to
    ``TEMPERATURES_K``.

    The chromaticity is computed with the cubic approximation of Kim et al. (2002).
    """
    t = 1000.0 / min(max(temperature_k, TEMPERATURES_K[0]), TEMPERATURES_K[1])
    if t > 0.25:
        x = ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.179910
    else:
        x = ((-3.0258469 * t + 2.1070379) * t + 0.2226347) * t + 0.240390
    if t > 1000.0 / 2222.0:
        y = ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683
    elif t > 0.25:
        y = ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867
    else:
        y = ((3.0817580 * x - 5.87338670) * x + 3.75112997) * x - 0.37001483
    rgb: FloatArray = np.maximum(TO_RGB @ np.array([x / y, 1.0, (1.0 - x - y) / y]), 0.01)
    return rgb
