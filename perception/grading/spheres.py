"""Measure an apple, which is an almost round body that lies on the plane, from its outline.

The rays through the outline form a cone around the apple. The opening angle of the cone and the height of the plane
determine the apple's diameter and position. An apple whose entire outline is visible may be an ellipsoid. Any other
apple is measured as a sphere.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray
from perception.camera_view import CameraView

Ellipse: TypeAlias = tuple[float, float, float, float, float]
"""Ellipse: center x, center y, half axes, and angle of the first axis in rad."""

Circle: TypeAlias = tuple[FloatArray, float]
"""Center (2,) and radius."""

LEAST_POINTS: Final = 12
LEAST_ARC: Final = 0.3
"""Minimum fraction of the outline required to determine a sphere."""
FULL_ARC: Final = 0.7
"""Minimum visible fraction of an outline to which an ellipse is fitted."""
LARGEST_RATIO: Final = 1.35
"""Maximum axis ratio of an apple's outline."""
ROUNDS: Final = 4
NOTCH: Final = 0.08
BUMP: Final = 0.12
"""Distance inside and outside a circle within which points belong to the circle, as a fraction of its radius."""
OFF_ELLIPSE: Final = 0.025
"""Distance from an ellipse within which points belong to the ellipse, as a fraction of its radius."""
PARTS: Final = 12
PART: Final = 5
"""Number of overlapping parts of an outline, and their length. Each part contains 5/12 of the points."""
START_POINTS: Final = 60
"""Number of points that are used to choose the initial circle of a fit."""
SECTORS: Final = 36
"""Number of sectors used to determine the visible fraction of an outline."""


@dataclass(frozen=True, slots=True, eq=False)
class AppleSphere:
    """Size and position of one apple."""

    center_m: FloatArray
    """Center (3,) in base_link, in m."""
    radius_m: float
    """Half of the largest diameter, in m."""
    frame: FloatArray
    """Axes (3, 3) of the cone, as columns. The last axis points toward the apple."""
    ellipse: Ellipse
    """Center x, center y, half axes and angle (rad) of the outline, in the plane at distance 1 along the cone."""
    arc: float
    """Fraction of the outline from which the apple was measured."""
    error: float
    """Mean distance of the outline from the ellipse, as a fraction of the ellipse's radius."""

    def inside(self, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the positions (n, 2) of rays (n, 3) relative to the outline scaled to radius 1, and their squared
        distances (n,)."""
        return _places(_flat(rays, self.frame), self.ellipse)


def fit_sphere(view: CameraView, pixels: FloatArray) -> AppleSphere | None:
    """Measure the apple whose outline consists of the pixels (n, 2). Returns None if the outline does not belong to an
    apple."""
    if len(pixels) < LEAST_POINTS:
        return None
    rays = view.rays(pixels)
    frame = _frame(rays.mean(axis=0))
    points = _flat(rays, frame)
    center, radius, kept = _robust_circle(points)
    if kept.sum() < LEAST_POINTS:
        return None
    arc = _arc(points[kept] - center)
    if arc < LEAST_ARC:
        return None
    ellipse = (float(center[0]), float(center[1]), radius, radius, 0.0)
    if arc >= FULL_ARC:
        ellipse = _robust_ellipse(points[kept]) or ellipse
    if max(ellipse[2:4]) > LARGEST_RATIO * min(ellipse[2:4]):
        return None
    off = np.linalg.norm(points - center, axis=1) / radius - 1.0
    error = float(np.abs(np.minimum(off, 0.0)).mean())
    return _placed(view, frame, ellipse, (arc, error))


def _placed(view: CameraView, frame: FloatArray, ellipse: Ellipse, quality: tuple[float, float]) -> AppleSphere | None:
    x, y, a, b, _ = ellipse
    toward = frame @ np.array([x, y, 1.0])
    toward = toward / np.linalg.norm(toward)
    # Near the center of the outline, a cone angle is the angle between the cone's axis and the outline.
    scale = 1.0 / (1.0 + x * x + y * y)
    sine = float(np.sin(np.arctan(max(a, b) * scale)))
    above_m = float(view.pose.position_m[2]) - view.pose.plane_height_m
    denominator = min(a, b) / max(a, b) - float(toward[2]) / sine
    if above_m <= 0.0 or denominator <= 0.0:
        return None
    radius_m = above_m / denominator
    center_m = view.pose.position_m + toward * radius_m / sine
    return AppleSphere(center_m, radius_m, frame, ellipse, *quality)


def _frame(toward: FloatArray) -> FloatArray:
    z = toward / np.linalg.norm(toward)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _flat(rays: FloatArray, frame: FloatArray) -> FloatArray:
    local = rays @ frame
    flat: FloatArray = local[:, :2] / np.maximum(local[:, 2:], 1e-3)
    return flat


def _robust_circle(points: FloatArray) -> tuple[FloatArray, float, NDArray[np.bool_]]:
    """Fit a circle to points (n, 2) along an outline.

    Return the center (2,), the radius, and which points are on the circle.

    Points inside the circle are the edges of spots and notches, and points outside the circle belong to another apple.
    The fit starts with the circle that fits a part of the outline and has the most points on it.
    """
    few = points[:: max(1, len(points) // START_POINTS)]
    starts = [_circle(part) for part in _parts(few)]
    center, radius = max(starts, key=lambda circle: int(_on(few, circle, NOTCH).sum()))
    kept = np.ones(len(points), dtype=bool)
    for _ in range(ROUNDS):
        kept = _on(points, (center, radius), BUMP)
        if kept.sum() < LEAST_POINTS:
            break
        center, radius = _circle(points[kept])
    return center, radius, kept


def _parts(points: FloatArray) -> Iterator[FloatArray]:
    """Yield all points of an outline, then its overlapping parts."""
    yield points
    length = len(points) * PART // PARTS
    for start in range(PARTS):
        yield np.roll(points, -len(points) * start // PARTS, axis=0)[:length]


def _on(points: FloatArray, circle: Circle, outside: float) -> NDArray[np.bool_]:
    """Return which points (n, 2) are on a circle, or outside it by up to the given fraction of its radius."""
    away = np.linalg.norm(points - circle[0], axis=1) / circle[1] - 1.0
    on: NDArray[np.bool_] = (away > -NOTCH) & (away < outside)
    return on


def _circle(points: FloatArray) -> Circle:
    """Return the center (2,) and the radius of the least-squares circle through the points (n, 2)."""
    middle = points.mean(axis=0)
    local = points - middle
    scale = float(np.abs(local).max()) or 1.0
    local = local / scale
    solution = np.linalg.lstsq(
        np.column_stack([2.0 * local, np.ones(len(local))]), (local * local).sum(axis=1), rcond=None
    )[0]
    radius = float(np.sqrt(max(solution[2] + solution[0] ** 2 + solution[1] ** 2, 1e-12)))
    return solution[:2] * scale + middle, radius * scale


def _robust_ellipse(points: FloatArray) -> Ellipse | None:
    """Fit an ellipse to points (n, 2), ignoring outliers. Returns None if the points do not determine an ellipse."""
    ellipse = _ellipse(points)
    for _ in range(ROUNDS):
        if ellipse is None:
            return None
        on = np.abs(np.sqrt(_places(points, ellipse)[1]) - 1.0) < OFF_ELLIPSE
        if on.sum() < LEAST_POINTS or _arc(points[on] - ellipse[:2]) < FULL_ARC:
            return ellipse
        ellipse = _ellipse(points[on])
    return ellipse


def _places(points: FloatArray, ellipse: Ellipse) -> tuple[FloatArray, FloatArray]:
    """Return the positions (n, 2) of points (n, 2) relative to an ellipse that is scaled to radius 1, and their squared
    distances (n,)."""
    x, y = (points - ellipse[:2]).T
    a, b, cos, sin = ellipse[2], ellipse[3], np.cos(ellipse[4]), np.sin(ellipse[4])
    along, across = (cos * x + sin * y) / a, (cos * y - sin * x) / b
    places = np.column_stack([cos * along - sin * across, sin * along + cos * across])
    return places, along * along + across * across


def _ellipse(points: FloatArray) -> Ellipse | None:
    """Return the ellipse through the points (n, 2), or None if they do not determine an ellipse."""
    middle = points.mean(axis=0)
    scale = float(np.abs(points - middle).max()) or 1.0
    local = ((points - middle) / scale).astype(np.float32)
    (x, y), (a, b), degrees = cv2.fitEllipseDirect(local)
    if not np.isfinite([x, y, a, b]).all() or min(a, b) <= 0.0:
        return None
    center = np.array([x, y]) * scale + middle
    return float(center[0]), float(center[1]), 0.5 * a * scale, 0.5 * b * scale, float(np.radians(degrees))


def _arc(away: FloatArray) -> float:
    """Return the fraction of directions from a center in which there are points (n, 2)."""
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi) + 0.5
    return len(np.unique((turns * SECTORS).astype(int) % SECTORS)) / SECTORS
