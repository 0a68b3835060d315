"""Paint apples on a table: a small renderer of spheres that shares no code with the virtual camera.

The light is the sum of a directional lamp (with shadows) and ambient light. Textures are linear albedos. The sRGB gamma
and the noise are applied last. The true values are counted in the same pixels.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from perception.camera_view import CameraView, looking_at
from perception.intrinsics import Intrinsics

Array = NDArray[np.float64]
RED = np.array([0.46, 0.04, 0.035])
GREEN = np.array([0.36, 0.50, 0.10])
YELLOW = np.array([0.66, 0.52, 0.12])
BROWN = np.array([0.17, 0.085, 0.035])
DARK = np.array([0.045, 0.032, 0.022])


@dataclass(frozen=True)
class PaintedApple:
    """Apple to be painted, whose true shape and colors are known."""

    center_m: Array
    radius_m: float
    ground: Array
    red_share: float
    """Height of the blush along its axis, from 0 (none) to 1 (all)."""
    blush_axis: Array
    spots: tuple[tuple[Array, float, Array], ...] = ()
    """Direction, angular radius in rad, and color of each spot."""


@dataclass
class PaintedTruth:
    """The camera's view of one apple."""

    diameter_mm: float
    position_m: Array
    red_ratio: float
    defect_score: float
    visible: float


@dataclass(frozen=True)
class Lamp:
    """The light of a picture."""

    direction: Array = field(default_factory=lambda: unit(np.array([-0.3, 0.4, 1.0])))
    color: Array = field(default_factory=lambda: np.ones(3))
    lamp: float = 1.0
    ambient: float = 0.4
    noise: float = 0.006


def unit(vector: Array) -> Array:
    return np.asarray(vector, dtype=float) / np.linalg.norm(vector)


def view(focal_px: float = 620.0, height_m: float = 0.5, back_m: float = 0.25) -> CameraView:
    """A camera that looks at (0.25, 0, 0) from behind and above."""
    intrinsics = Intrinsics.pinhole(focal_px, 640, 480)
    return CameraView(intrinsics, looking_at(np.array([0.25 - back_m, 0.0, height_m]), np.array([0.25, 0.0, 0.0]), 0.0))


def paint(
    view: CameraView, apples: list[PaintedApple], lamp: Lamp, seed: int, table: Array | None = None
) -> tuple[NDArray[np.uint8], list[PaintedTruth]]:
    """Return a picture (h, w, 3) and the true values of each apple."""
    table = np.array([0.55, 0.55, 0.55]) if table is None else table
    width, height = view.intrinsics.size
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
    rays, eye = view.rays(grid), view.pose.position_m
    down = np.minimum(rays[:, 2], -1e-3)
    distance = (view.pose.plane_height_m - eye[2]) / down
    owner = np.full(len(rays), -1)
    for index, apple in enumerate(apples):
        hit = hits(eye - apple.center_m, rays, apple.radius_m)
        owner[hit < distance] = index
        distance = np.minimum(distance, hit)
    points = eye + rays * distance[:, None]
    normal = np.tile([0.0, 0.0, 1.0], (len(rays), 1))
    albedo = np.tile(table, (len(rays), 1))
    truths = []
    for index, apple in enumerate(apples):
        mine = owner == index
        normal[mine] = (points[mine] - apple.center_m) / apple.radius_m
        albedo[mine], red, bad = texture(apple, normal[mine])
        alone = np.isfinite(hits(eye - apple.center_m, rays, apple.radius_m)).sum()
        truths.append(
            PaintedTruth(
                2000 * apple.radius_m,
                apple.center_m,
                red.sum() / max(len(red), 1),
                bad.sum() / max(len(bad), 1),
                mine.sum() / alone,
            )
        )
    lit = np.maximum(normal @ lamp.direction, 0.0)
    for apple in apples:
        start = points + normal * 1e-4
        lit[np.isfinite(hits(start - apple.center_m, np.tile(lamp.direction, (len(rays), 1)), apple.radius_m))] = 0.0
    sky = lamp.ambient * (0.6 + 0.4 * normal[:, 2])
    linear = albedo * lamp.color * (lamp.lamp * lit + sky)[:, None]
    rng = np.random.default_rng(seed)
    linear = linear + rng.normal(size=linear.shape) * lamp.noise * np.sqrt(np.maximum(linear, 0.0) + 0.01)
    return srgb(linear).reshape(height, width, 3), truths


def hits(start: Array, rays: Array, radius: float) -> Array:
    """Return the distances of the first hits of rays on a sphere about the origin; inf without a hit."""
    along = rays @ start if start.ndim == 1 else (rays * start).sum(axis=1)
    inside = along**2 - (start**2).sum(axis=-1) + radius**2
    near = -along - np.sqrt(np.maximum(inside, 0.0))
    return np.where((inside > 0.0) & (near > 0.0), near, np.inf)


def texture(apple: PaintedApple, normal: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the albedo of points of an apple, whether they are red, and whether they are defects."""
    height = 0.5 + 0.5 * (normal @ unit(apple.blush_axis))
    height = height + 0.03 * np.sin(9.0 * np.arctan2(normal[:, 1], normal[:, 0]))
    mix = np.clip((height - (1.0 - apple.red_share)) / 0.04 + 0.5, 0.0, 1.0)
    if apple.red_share in (0.0, 1.0):
        mix[:] = apple.red_share
    albedo = apple.ground + mix[:, None] * (RED - apple.ground)
    bad = np.zeros(len(normal), dtype=bool)
    for direction, angle, color in apple.spots:
        inside = normal @ unit(direction) > np.cos(angle)
        albedo[inside], bad[inside] = color, True
    return albedo, (mix > 0.5) & ~bad, bad


def srgb(linear: Array) -> NDArray[np.uint8]:
    linear = np.clip(linear, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255.0 * encoded).astype(np.uint8)


def random_apples(rng: np.random.Generator, count: int, gap_m: float = 0.005) -> list[PaintedApple]:
    """Return apples that lie beside each other in front of ``view()``."""
    apples: list[PaintedApple] = []
    while len(apples) < count:
        radius = rng.uniform(0.018, 0.04)
        center = np.array([rng.uniform(0.12, 0.36), rng.uniform(-0.14, 0.14), radius])
        if all(np.linalg.norm(center - other.center_m) > radius + other.radius_m + gap_m for other in apples):
            apples.append(random_apple(rng, center, radius))
    return apples


def random_apple(rng: np.random.Generator, center: Array, radius: float) -> PaintedApple:
    spots = tuple(
        (rng.normal(size=3) + np.array([-0.5, 0.0, 0.7]), rng.uniform(0.12, 0.6), BROWN if rng.random() < 0.6 else DARK)
        for _ in range(rng.integers(0, 4))
    )
    ground = GREEN if rng.random() < 0.5 else YELLOW
    share = float(rng.choice([0.0, 1.0, rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9)]))
    return PaintedApple(center, radius, ground, share, rng.normal(size=3), spots)


def random_lamp(rng: np.random.Generator) -> Lamp:
    warm = rng.uniform(-0.35, 0.35)
    color = np.array([1.0 + warm, 1.0, 1.0 - warm])
    direction = unit(np.array([*rng.uniform(-0.7, 0.7, 2), 1.0]))
    return Lamp(direction, color, rng.uniform(0.4, 0.9), rng.uniform(0.2, 0.5), rng.uniform(0.003, 0.015))
