"""Pictures of the arm at work, by ray casting in numpy: no OpenGL, so they work on every machine.

One ray a pixel from the camera, one from the lamp for its shadow, Lambert shading. Smooth pictures are
the mean of four, each with the rays a quarter of a pixel off and the lamp moved a little.
MuJoCo says where the geoms are; its own mj_multiRay cuts pieces off them (it culls too much).
Images are uint8 arrays of shape (height, width, 3); n is the number of rays.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim_backend.world import World

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

CAMERA: Final = "overview"
VISIBLE_GROUPS: Final = (0, 1, 2)
"""Geom groups that are drawn; the others only serve the simulation."""
PLANE: Final = int(mujoco.mjtGeom.mjGEOM_PLANE)
BOX: Final = int(mujoco.mjtGeom.mjGEOM_BOX)
CYLINDER: Final = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
SKY: Final = np.array([0.93, 0.95, 0.97])
AMBIENT: Final = 0.48
LAMP_M: Final = 0.02
"""How far the lamp is moved to either side for a soft shadow."""
TILE_M: Final = 0.1
FADE_M: Final = (0.7, 2.2)
"""Where the floor begins to turn into sky, and where it has."""
QUARTERS: Final = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


def render(
    model: Any, data: Any, camera: str = CAMERA, width: int = 480, height: int = 360, smooth: bool = True
) -> Picture:
    """What `camera` sees of a model whose kinematics are up to date. Smooth costs four times as much."""
    passes = QUARTERS if smooth else ((0.0, 0.0),)
    view = data.cam(camera)
    focal = 0.5 * height / np.tan(0.5 * np.radians(model.cam(camera).fovy[0]))
    total = np.zeros((width * height, 3))
    for dx, dy in passes:
        rays = _turn(_rays(width, height, focal, dx, dy), view.xmat.reshape(3, 3).T)
        lamp = data.light_xpos[0] + 4.0 * LAMP_M * np.array([dx, dy, 0.0])
        total += _shade(model, data, view.xpos, rays, lamp)
    shades = np.clip(total / len(passes), 0.0, 1.0)
    return (255.0 * shades + 0.5).astype(np.uint8).reshape(height, width, 3)


def _rays(width: int, height: int, focal: float, dx: float, dy: float) -> FloatArray:
    """Unit vectors through all pixels in the camera's frame (x right, y up, z back), shape (n, 3)."""
    x, y = np.meshgrid(np.arange(width) + 0.5 + dx - width / 2, height / 2 - np.arange(height) - 0.5 - dy)
    rays = np.stack([x, y, np.full_like(x, -focal)], axis=-1).reshape(-1, 3)
    unit: FloatArray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _turn(vectors: FloatArray, matrix: FloatArray) -> FloatArray:
    """`vectors @ matrix`, on one core: the threads of a matrix library cost more than they do here."""
    turned: FloatArray = np.einsum("ni,ij->nj", vectors, matrix)
    return turned


def _cast(model: Any, data: Any, origin: FloatArray, rays: FloatArray) -> tuple[Any, FloatArray, FloatArray]:
    """First hit of each ray: geom (n,), -1 for none; distance (n,), infinite for none; normal (n, 3)."""
    n = len(rays)
    columns = np.asfortranarray(rays, dtype=np.float32)
    nearest, geom, normal = np.full(n, np.inf), np.full(n, -1), np.zeros((n, 3))
    for i in np.flatnonzero(np.isin(model.geom_group, VISIBLE_GROUPS)):
        axes, away = data.geom_xmat[i].reshape(3, 3), data.geom_xpos[i] - origin
        index = _candidates(columns, away, model.geom_rbound[i])
        distance, local = _hit(model.geom_type[i], model.geom_size[i], -away @ axes, _turn(rays[index], axes))
        first = distance < nearest[index]
        index = index[first]
        nearest[index], geom[index] = distance[first], i
        normal[index] = _turn(local[first], axes.T)
    return geom, nearest, normal


def _candidates(columns: Any, away: FloatArray, radius: float) -> Any:
    """Indices of the rays that meet the bounding sphere; all of them for a plane (radius 0).

    Most of the time goes here: single precision, column by column, and nothing but one comparison.
    """
    if radius == 0.0:
        return np.arange(len(columns))
    x, y, z = away.astype(np.float32)
    along = columns[:, 0] * x
    along += columns[:, 1] * y
    along += columns[:, 2] * z
    nearest = float(away @ away) - (1.001 * radius) ** 2
    return np.flatnonzero(along > np.float32(max(0.0, nearest) ** 0.5))


def _hit(kind: int, size: FloatArray, origin: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance (infinite for none) and normal of the first hit, all in the geom's own frame.

    The solids are convex, so each is a meeting of slabs (and a round wall): a ray is inside from the
    last entry to the first exit.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        if kind == PLANE:
            distance = np.where(rays[:, 2] < 0.0, -origin[2] / rays[:, 2], np.inf)
            return distance, np.tile([0.0, 0.0, 1.0], (len(rays), 1))
        half = size if kind == BOX else np.array([np.inf, np.inf, size[1]])
        middle, reach = -origin / rays, np.abs(half / rays)
        enter, leave = middle - reach, middle + reach
        normal = -np.sign(rays)
        if kind == CYLINDER:
            enter[:, 0], leave[:, 0], wall = _round_wall(size[0], origin[:2], rays[:, :2])
            enter[:, 1], leave[:, 1] = -np.inf, np.inf
        elif kind != BOX:
            raise ValueError(f"pictures are made of planes, boxes and cylinders; this is geom type {kind}")
    last = np.argmax(enter, axis=1)
    rows = np.arange(len(rays))
    distance = enter[rows, last]
    local = np.zeros_like(rays)
    local[rows, last] = normal[rows, last]
    if kind == CYLINDER:
        round_ = last == 0
        local[round_, :2] = wall[round_]
        local[round_, 2] = 0.0
    return np.where((distance <= leave.min(axis=1)) & (distance > 0.0), distance, np.inf), local


def _round_wall(radius: float, origin: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where rays in the plane enter and leave a circle about zero (NaN: never), and the wall's normal."""
    a = np.sum(rays * rays, axis=1)
    b = rays @ origin
    root = np.sqrt(b * b - a * (origin @ origin - radius * radius))
    enter = np.nan_to_num((-b - root) / a, nan=np.inf)
    return enter, np.nan_to_num((-b + root) / a, nan=-np.inf), (origin + rays * enter[:, None]) / radius


def _shade(model: Any, data: Any, eye: FloatArray, rays: FloatArray, lamp: FloatArray) -> FloatArray:
    """Colours of all rays, shape (n, 3), 0 to 1."""
    geom, distance, normal = _cast(model, data, eye, rays)
    hit = geom >= 0
    point = eye + rays[hit] * distance[hit, None]
    away = point - lamp
    reach = np.linalg.norm(away, axis=1)
    toward = away / reach[:, None]
    _, first, _ = _cast(model, data, lamp, toward)
    lit = np.where(first > reach - 1e-4, np.maximum(0.0, -np.sum(normal[hit] * toward, axis=1)), 0.0)
    from_above = AMBIENT * (0.8 + 0.2 * normal[hit, 2])
    colour = np.tile(SKY, (len(rays), 1))
    colour[hit] = _colours(model, geom[hit], point, from_above + (1.0 - AMBIENT) * lit)
    return colour


def _colours(model: Any, geom: Any, point: FloatArray, light: FloatArray) -> FloatArray:
    """The geoms' own colours in this light; the floor has tiles and fades into the sky."""
    colour: FloatArray = model.geom_rgba[geom, :3] * light[:, None]
    floor = model.geom_type[geom] == PLANE
    x, y = point[floor, 0], point[floor, 1]
    tile = (np.floor(x / TILE_M) + np.floor(y / TILE_M)) % 2
    near, far = FADE_M
    fade = np.clip((np.hypot(x - 0.2, y) - near) / (far - near), 0.0, 1.0)[:, None]
    colour[floor] = colour[floor] * (1.0 - 0.06 * tile[:, None]) * (1.0 - fade) + SKY * fade
    return colour


def save_png(path: Path, image: Picture) -> None:
    """Write one picture."""
    Image.fromarray(image).save(path, optimize=True)


def save_gif(path: Path, images: Sequence[Picture], fps: float) -> None:
    """Write a film that repeats. One palette for all frames: smaller, and it does not flicker."""
    palette = Image.fromarray(np.concatenate(images[:: max(1, len(images) // 4)])).quantize(256, kmeans=2)
    frames = [Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=round(1000 / fps), loop=0)


class Recorder:
    """Remembers how the world stood, to draw it when there is time. Rests are left out."""

    def __init__(self, world: World, period_s: float = 0.3, frames: int = 75) -> None:
        """Look every `period_s` of world time; keep at most the first `frames` of those in which it moved."""
        self._world = world
        self._period_s = period_s
        self._frames = frames
        self._next_s = world.time_s
        self._taken: list[FloatArray] = []
        self._best = world.configuration()

    def update(self, time_s: float) -> None:
        """To be called at least once a period; costs next to nothing in between."""
        if time_s < self._next_s:
            return
        self._next_s = time_s + self._period_s
        now = self._world.configuration()
        self._best = max(self._best, now, key=self._world.cube_height_m)
        still = self._taken and np.abs(now - self._taken[-1]).max() < 1e-3
        if len(self._taken) < self._frames and not still:
            self._taken.append(now)

    def save(self, folder: Path, fps: float = 8.0, width: int = 960) -> None:
        """Draw `arm.png` (the cube held at its highest) and `arm.gif`, half as wide, into `folder`."""
        folder.mkdir(parents=True, exist_ok=True)
        save_png(folder / "arm.png", self._draw(self._best, width, smooth=True))
        frames = self._taken or [self._best]
        save_gif(folder / "arm.gif", [self._draw(q, width // 2, smooth=False) for q in frames], fps)

    def _draw(self, configuration: FloatArray, width: int, smooth: bool) -> Picture:
        # Its own data: drawing must not disturb the world.
        model = self._world.model
        data = mujoco.MjData(model)
        data.qpos[:] = configuration
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        return render(model, data, width=width, height=width * 3 // 4, smooth=smooth)
