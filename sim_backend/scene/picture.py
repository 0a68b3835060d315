"""Images of the arm, rendered by ray casting. OpenGL is not needed, so images can be rendered on any computer.

For each pixel, one ray is cast from the camera and one from the lamp for shadows, with Lambert shading. A smooth image
is the mean of four images. Their rays are shifted by a quarter of a pixel, and their lamps have slightly different
positions.
Images are uint8 arrays of shape (height, width, 3); n is the number of rays.
"""

from collections.abc import Sequence
from math import floor, sqrt
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim_backend.compiled import compiled
from sim_backend.scene.ray_types import FloatArray
from sim_backend.scene.rays import PLANE, cast, visible
from sim_backend.scene.world import World

Picture = NDArray[np.uint8]

CAMERA: Final = "overview"
SKY: Final = np.array([0.93, 0.95, 0.97])
AMBIENT: Final = 0.48
LAMP_M: Final = 0.02
"""Distance by which the lamp is moved in each direction for soft shadows, in meters."""
TILE_M: Final = 0.1
FADE_M: Final = (0.7, 2.2)
"""Distance at which the floor begins to fade into the sky, and distance at which it has faded completely, in meters."""
TOUCH_M: Final = 1e-4
"""Maximum distance, in meters, between a point and the hit of a ray that still counts as reaching the point."""
QUARTERS: Final = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


class View:
    """View of a model from a fixed camera. Parts that never move are traced and shaded once for all images."""

    def __init__(
        self, model: Any, data: Any, camera: str = CAMERA, width: int = 480, height: int = 360, smooth: bool = True
    ) -> None:
        """Prepare the view. ``data`` contains any pose with updated kinematics. Smooth images take four times as
        long."""
        self._shape = (height, width, 3)
        view = data.cam(camera)
        focal = 0.5 * height / np.tan(0.5 * np.radians(model.cam(camera).fovy[0]))
        self._passes = []
        for dx, dy in QUARTERS if smooth else ((0.0, 0.0),):
            # A matrix product would start the threads of the matrix library on processors that other programs may need.
            rays = np.einsum("ni,ji->nj", _rays(width, height, focal, dx, dy), view.xmat.reshape(3, 3))
            lamp = data.light_xpos[0] + 4.0 * LAMP_M * np.array([dx, dy, 0.0])
            self._passes.append(_Pass(model, data, view.xpos.copy(), rays, lamp))

    def picture(self, data: Any) -> Picture:
        """Return the image of a pose with updated kinematics."""
        total = sum(one.colors(data) for one in self._passes)
        shades = np.clip(total / len(self._passes), 0.0, 1.0)
        return (255.0 * shades + 0.5).astype(np.uint8).reshape(self._shape)


class _Pass:
    """One ray per pixel, with a single lamp position. ``_still`` contains the geoms that are fixed to the world."""

    def __init__(self, model: Any, data: Any, eye: FloatArray, rays: FloatArray, lamp: FloatArray) -> None:
        self._model, self._eye, self._rays, self._lamp = model, eye, rays, lamp
        self._all = visible(model)
        is_still = model.body_weldid[model.geom_bodyid[self._all]] == 0
        self._still, self._moving = self._all[is_still], self._all[~is_still]
        self._hits = cast(model, data, eye, rays, self._still)
        geom, distance, normal = self._hits
        seen = np.flatnonzero(geom >= 0)
        point = eye + rays[seen] * distance[seen, None]
        toward, reach = _from(lamp, point)
        _, first, _ = cast(model, data, lamp, toward, self._still)
        lit = _lit(first, reach, normal[seen], toward)
        self._colors = np.tile(SKY, (len(rays), 1))
        self._colors[seen] = self._paint(geom[seen], point, _light(normal[seen], lit))
        # Only lit points can be in the shadow of a moving geom.
        bright = np.flatnonzero(lit > 0.0)
        self._bright, self._toward, self._reach = seen[bright], toward[bright], reach[bright]
        dark = _light(normal[self._bright], np.zeros(len(bright)))
        self._dark = self._paint(geom[self._bright], point[bright], dark)

    def colors(self, data: Any) -> FloatArray:
        """Return the colors of all rays, shape (n, 3), from 0 to 1."""
        model, colors = self._model, self._colors.copy()
        _, first, _ = cast(model, data, self._lamp, self._toward, self._moving)
        shadow = first <= self._reach - TOUCH_M
        colors[self._bright[shadow]] = self._dark[shadow]
        geom, distance, normal = cast(model, data, self._eye, self._rays, self._moving, self._hits)
        changed = np.flatnonzero(distance < self._hits[1])
        point = self._eye + self._rays[changed] * distance[changed, None]
        toward, reach = _from(self._lamp, point)
        _, first, _ = cast(model, data, self._lamp, toward, self._all)
        lit = _lit(first, reach, normal[changed], toward)
        colors[changed] = self._paint(geom[changed], point, _light(normal[changed], lit))
        return colors

    def _paint(self, geom: Any, point: FloatArray, light: FloatArray) -> FloatArray:
        return _colors(self._model.geom_rgba, self._model.geom_type, geom, point, light)


def _from(lamp: FloatArray, point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors from the lamp to each point, and the distances."""
    away = point - lamp
    reach = np.linalg.norm(away, axis=1)
    return away / reach[:, None], reach


def _lit(first: FloatArray, reach: FloatArray, normal: FloatArray, toward: FloatArray) -> FloatArray:
    """Return the fraction of the lamp's light that reaches each point.

    The fraction is 0 if the ``first`` hit of the lamp's ray is another point.
    """
    return np.where(first > reach - TOUCH_M, np.maximum(0.0, -np.sum(normal * toward, axis=1)), 0.0)


def _light(normal: FloatArray, lit: FloatArray) -> FloatArray:
    """Return the total light on each point: the lamp's light, and ambient light that comes mostly from above."""
    light: FloatArray = AMBIENT * (0.8 + 0.2 * normal[:, 2]) + (1.0 - AMBIENT) * lit
    return light


def _rays(width: int, height: int, focal: float, dx: float, dy: float) -> FloatArray:
    """Return unit vectors through all pixels in the camera's frame (x right, y up, z back), shape (n, 3)."""
    x, y = np.meshgrid(np.arange(width) + 0.5 + dx - width / 2, height / 2 - np.arange(height) - 0.5 - dy)
    rays = np.stack([x, y, np.full_like(x, -focal)], axis=-1).reshape(-1, 3)
    unit: FloatArray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


@compiled
def _colors(rgba: Any, kinds: Any, geom: Any, point: FloatArray, light: FloatArray) -> FloatArray:
    """Return the colors of geoms in this light. The floor has tiles and fades into the sky."""
    near, far = FADE_M
    color = np.empty((len(geom), 3))
    for n in range(len(geom)):
        tile, fade = 1.0, 0.0
        if kinds[geom[n]] == PLANE:
            x, y = point[n, 0], point[n, 1]
            tile = 1.0 - 0.06 * ((floor(x / TILE_M) + floor(y / TILE_M)) % 2)
            fade = min(max((sqrt((x - 0.2) ** 2 + y**2) - near) / (far - near), 0.0), 1.0)
        for i in range(3):
            color[n, i] = rgba[geom[n], i] * light[n] * tile * (1.0 - fade) + SKY[i] * fade
    return color


def save_png(path: Path, image: Picture) -> None:
    """Save an image as a PNG file."""
    Image.fromarray(image).save(path, optimize=True)


def save_gif(path: Path, images: Sequence[Picture], fps: float) -> None:
    """Save a looping animation. One palette for all frames makes the file smaller and prevents flicker."""
    palette = Image.fromarray(np.concatenate(images[:: max(1, len(images) // 4)])).quantize(256, kmeans=2)
    frames = [Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=round(1000 / fps), loop=0)


class FilmRecorder:
    """Recorder of the world's motion, so that it can be rendered later. Phases without motion are omitted."""

    def __init__(self, world: World, period_s: float = 0.3, frames: int = 75) -> None:
        """Record a frame every `period_s` of world time, but only the first `frames` frames in which the world has
        moved."""
        self._world = world
        self._period_s = period_s
        self._frames = frames
        self._next_s = world.time_s
        self._taken: list[FloatArray] = []
        self._best = world.configuration()

    def update(self, time_s: float) -> None:
        """Record a frame if one is due. Call this method at least once per period; most calls return immediately."""
        if time_s < self._next_s:
            return
        self._next_s = time_s + self._period_s
        now = self._world.configuration()
        self._best = max(self._best, now, key=self._world.cube_height_m)
        still = self._taken and np.abs(now - self._taken[-1]).max() < 1e-3
        if len(self._taken) < self._frames and not still:
            self._taken.append(now)

    def save(self, folder: Path, fps: float = 8.0, width: int = 960) -> None:
        """Save `arm.png`, and `arm.gif` with half the width, to `folder`."""
        folder.mkdir(parents=True, exist_ok=True)
        self.save_still(folder / "arm.png", width)
        self.save_film(folder / "arm.gif", fps, width // 2)

    def save_still(self, path: Path, width: int = 960) -> None:
        """Render the moment when the cube was at its highest position."""
        save_png(path, *self._draw([self._best], width, smooth=True))

    def save_film(self, path: Path, fps: float = 8.0, width: int = 480) -> None:
        """Render all recorded frames."""
        save_gif(path, self._draw(self._taken or [self._best], width, smooth=False), fps)

    def _draw(self, configurations: Sequence[FloatArray], width: int, smooth: bool) -> list[Picture]:
        model = self._world.drawn_model()  # A separate model is used, because drawing must not disturb the world.
        data = mujoco.MjData(model)
        _place(model, data, configurations[0])
        view = View(model, data, width=width, height=width * 3 // 4, smooth=smooth)
        pictures = []
        for configuration in configurations:
            _place(model, data, configuration)
            pictures.append(view.picture(data))
        return pictures


def _place(model: Any, data: Any, configuration: FloatArray) -> None:
    """Move geoms, cameras and lamps to their poses in a ``configuration``."""
    data.qpos[:] = configuration
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
