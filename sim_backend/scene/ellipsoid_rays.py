"""First hits of rays on an ellipsoid of a MuJoCo model, in compiled code. A sphere has three equal radii."""

from math import sqrt

import numpy as np

from sim_backend.compiled import compiled
from sim_backend.scene.ray_types import FloatArray, GeomView, RayHits


@compiled
def cast_ellipsoid(radii: FloatArray, view: GeomView, hits: RayHits) -> None:
    """Store each ray's hit on one ellipsoid if it is nearer than the hit stored so far.

    The ellipsoid has ``radii`` (3,), in meters. In units of these radii, it is a unit sphere.
    """
    number, axes, away, origin, beside = view
    rays, geom, nearest, normal = hits
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
