"""Rays from one point, and the selection of the rays that can hit given geoms. n is the number of rays."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

CELLS: Final = 96
"""Number of grid cells along each side of the grid."""
NEAREST: Final = 1e-6
"""Minimum component of a ray along the axis of its bundle. All rays must point to the same side of their origin."""


class Bundle:
    """Rays from one point, sorted into the cells of a grid that is perpendicular to their mean direction."""

    def __init__(self, origin: FloatArray, rays: FloatArray) -> None:
        """Sort unit vectors (n, 3) into the cells of the grid. Raises ValueError if the angle between a ray and the
        mean direction of the rays is 90 degrees or more."""
        self.origin, self.rays = origin, rays
        self._axes = _axes(rays.mean(axis=0) if len(rays) else np.array([0.0, 0.0, 1.0]))
        turned = np.einsum("ni,ij->nj", rays, self._axes)
        if len(rays) and turned[:, 2].min() < NEAREST:
            raise ValueError("each ray of a bundle must be less than 90 degrees from their mean direction")
        places = turned[:, :2] / turned[:, 2:]
        self._low = places.min(axis=0) if len(rays) else np.zeros(2)
        size = np.ptp(places, axis=0) if len(rays) else np.ones(2)
        self._cell = np.maximum(size, NEAREST) / CELLS
        columns, rows = np.minimum((places - self._low) / self._cell, CELLS - 1).astype(np.int64).T
        self._cells = rows * CELLS + columns

    def near(self, model: Any, data: Any, geoms: Any) -> NDArray[np.int64]:
        """Return the indices of all rays that can hit one of the geoms. A few additional rays may be included."""
        mask = np.zeros((CELLS, CELLS), np.bool_)
        middles = np.einsum("ni,ij->nj", data.geom_xpos[geoms] - self.origin, self._axes)
        for (x, y, z), radius in zip(middles.tolist(), model.geom_rbound[geoms].tolist(), strict=True):
            if z < -radius:
                continue
            if radius == 0.0 or z < 2.0 * radius:  # A plane has no bounding sphere.
                mask[:] = True
                continue
            (left, right), (low, high) = (self._span(i, middle, z, radius) for i, middle in enumerate((x, y)))
            mask[low:high, left:right] = True
        return np.flatnonzero(mask.ravel()[self._cells])

    def _span(self, side: int, middle: float, depth: float, radius: float) -> tuple[int, int]:
        """Return the range of cells that a sphere covers along one side of the grid: the first cell, and the cell after
        the last."""
        depths = (depth - radius, depth + radius)
        low, high = min((middle - radius) / z for z in depths), max((middle + radius) / z for z in depths)
        first, last = ((end - self._low[side]) / self._cell[side] for end in (low, high))
        return int(min(max(first, 0.0), CELLS)), int(min(max(last + 1.0, 0.0), CELLS))


def _axes(direction: FloatArray) -> FloatArray:
    """Return perpendicular unit vectors as columns; the last column points in the given direction."""
    forward = direction / np.linalg.norm(direction)
    aside = np.eye(3)[int(np.argmin(np.abs(forward)))]
    first = np.cross(aside, forward)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(forward, first), forward])
