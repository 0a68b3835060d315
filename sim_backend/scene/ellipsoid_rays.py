"""First hits of rays on an ellipsoid of a MuJoCo model, in compiled code. A sphere has three equal radii."""

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backend.compiled import compiled

FloatArray = NDArray[np.float64]


@compiled
def cast_ellipsoid(
    number: int, radii: FloatArray, axes: FloatArray, away: FloatArray, origin: FloatArray, beside: float,
    rays: FloatArray, geom: Any, nearest: FloatArray, normal: FloatArray,
) -> None:  # fmt: skip
    """Store the rays whose first hit is on one ellipsoid, with ``radii`` (3,) in meters.

    The other arguments are the same as those of ``rays._cast_one``. In units of the radii, the ellipsoid is a unit
    sphere.
    """
    x, y, z = away
    start, ray, slope = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        start[i] = origin[i] / radii[i]
    c = start[0] * start[0] + start[1] * start[1] + start[2] * start[2] - 1.0
    for n in range(len(rays)):
        if rays[n, 0] * x + rays[n, 1] * y + rays[n, 2] * z <= beside:
            continue
        for i in range(3):
            turned = rays[n, 0] * axes[0, i] + rays[n, 1] * axes[1, i] + rays[n, 2] * axes[2, i]
            ray[i] = turned / radii[i]
        a = ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]
        b = ray[0] * start[0] + ray[1] * start[1] + ray[2] * start[2]
        inside = b * b - a * c
        distance = (-b - sqrt(inside)) / a if inside >= 0.0 else -1.0
        if not 0.0 < distance < nearest[n]:
            continue
        nearest[n], geom[n] = distance, number
        for i in range(3):
            slope[i] = (start[i] + distance * ray[i]) / radii[i]
        length = sqrt(slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2])
        for i in range(3):
            normal[n, i] = (axes[i, 0] * slope[0] + axes[i, 1] * slope[1] + axes[i, 2] * slope[2]) / length
