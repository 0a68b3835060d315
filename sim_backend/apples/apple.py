"""Apples for the virtual camera, whose size, shape, color and defects are drawn at random from a seed."""

from dataclasses import dataclass
from typing import Final

import numpy as np

DIAMETERS_MM: Final = (60.0, 90.0)
"""Range of orchard apple diameters, in millimeters."""
HEIGHTS: Final = (0.88, 1.0)
"""Range of apple heights, as a fraction of the diameter."""
SOUND_SHARE: Final = 0.45
"""Fraction of apples without any defect."""
MOST_SPOTS: Final = 5
SPOTS_RAD: Final = (0.1, 0.5)
"""Range of spot radii, as angles measured at the apple's center."""
DARK_SHARE: Final = 0.35
"""Fraction of spots that are dark. The other spots are brown."""


@dataclass(frozen=True, slots=True)
class Spot:
    """One skin defect: a round spot with an irregular edge."""

    direction: tuple[float, float, float]
    """Unit vector from the apple's center to the spot's center."""
    radius_rad: float
    dark: bool
    """Whether the spot is almost black. If false, the spot is brown."""


@dataclass(frozen=True, slots=True)
class Apple:
    """One apple. The apple is an ellipsoid that is round about its vertical axis."""

    diameter_mm: float
    """Largest diameter, seen from above."""
    height: float
    """Height as a fraction of the diameter."""
    red_share: float
    """Fraction of the skin that is red, not counting spots. The rest is green."""
    spots: tuple[Spot, ...]
    seed: int
    """Random seed for the pattern and the exact colors."""

    @property
    def radii_m(self) -> tuple[float, float, float]:
        """Radii along x, y and z, in meters."""
        radius_m = 0.0005 * self.diameter_mm
        return radius_m, radius_m, radius_m * self.height


def draw_apple(seed: int, diameters_mm: tuple[float, float] = DIAMETERS_MM) -> Apple:
    """Return a random apple. The same seed always returns the same apple."""
    random = np.random.default_rng(seed)
    diameter_mm, height = random.uniform(*diameters_mm), random.uniform(*HEIGHTS)
    red_share = random.uniform()
    count = 0 if random.uniform() < SOUND_SHARE else int(random.integers(1, MOST_SPOTS + 1))
    return Apple(diameter_mm, height, red_share, tuple(_draw_spot(random) for _ in range(count)), seed)


def _draw_spot(random: np.random.Generator) -> Spot:
    x, y, z = random.normal(size=3)
    length = float(np.sqrt(x * x + y * y + z * z))
    return Spot((x / length, y / length, z / length), random.uniform(*SPOTS_RAD), bool(random.uniform() < DARK_SHARE))
