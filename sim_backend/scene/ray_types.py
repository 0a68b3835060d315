"""Arguments of the compiled functions that find the first hits of rays. n is the number of rays."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class GeomView(NamedTuple):
    """Geom of a MuJoCo model, as seen from the starting point of the rays."""

    number: int
    """Index of the geom in the model."""
    axes: FloatArray
    """Axes of the geom's frame, as the columns of a rotation matrix (3, 3)."""
    away: FloatArray
    """Vector (3,) from the starting point of the rays to the geom's center, in meters."""
    origin: FloatArray
    """Starting point (3,) of the rays in the geom's frame, in meters."""
    beside: float
    """Rays whose component along ``away`` is not greater than this value miss the geom's bounding sphere."""


class RayHits(NamedTuple):
    """Rays, and the nearest hit of each ray so far. The functions write the hits into these arrays."""

    rays: FloatArray
    """Directions (n, 3) of the rays."""
    geom: Any
    """Indices (n,) of the geoms that were hit; -1 if there is no hit."""
    nearest: FloatArray
    """Distances (n,) of the hits; infinite if there is no hit."""
    normal: FloatArray
    """Normals (n, 3) of the surfaces at the hits."""
