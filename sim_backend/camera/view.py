"""View of a MuJoCo model through the virtual camera. n is the number of pixels.

Geoms that never move are traced and shaded only once for all images.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_backend.camera.bundle import Bundle
from sim_backend.camera.light import Light
from sim_backend.camera.pinhole import PinholeCamera
from sim_backend.camera.shading import albedo, linear, shade
from sim_backend.camera.skin import NO_SKIN, Skin, paint
from sim_backend.scene.ray_types import FloatArray
from sim_backend.scene.rays import Hits, cast, visible

LAMP_M: Final = 20.0
"""Distance of the lamp, in meters. The rays of the lamp are almost parallel."""
TOUCH_M: Final = 1e-4
"""Maximum distance, in meters, between a point and the hit of a ray that still counts as reaching the point."""
SKY: Final = np.array([0.75, 0.78, 0.82])
"""Color of pixels that do not show any geom."""
QUARTERS: Final = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
SHARP: Final = ((0.0, 0.0),)


@dataclass(frozen=True, slots=True)
class Sight:
    """Ray hits of one image."""

    radiance: FloatArray
    """Linear RGB relative to a fully lit white surface, shape (n, 3)."""
    geom: NDArray[np.int64]
    """Geom that each ray hits, shape (n,); -1 if the ray does not hit a geom."""
    kind: NDArray[np.int8]
    """Skin type at each hit, shape (n,)."""


def mean_radiance(sights: Sequence[Sight]) -> FloatArray:
    """Return the radiances (n, 3) of an image as the mean of the radiances of its passes."""
    total = sights[0].radiance.copy()
    for sight in sights[1:]:
        total += sight.radiance
    total /= len(sights)
    return total


class FixedView:
    """View of a fixed camera under constant lighting."""

    def __init__(
        self,
        model: Any,
        data: Any,
        camera: PinholeCamera,
        light: Light,
        skins: Mapping[int, Skin],
        smooth: bool = False,
    ) -> None:
        """Prepare the view.

        Args:
            model: The MuJoCo model.
            data: MuJoCo data of the model in any pose, with updated kinematics.
            camera: The camera.
            light: The light.
            skins: Skins of the apples, keyed by geom. The apples can move.
            smooth: Whether to use four rays per pixel, which takes four times as long.
        """
        self.skins = dict(skins)
        self._model, self._camera, self._light = model, camera, light
        shifts = QUARTERS if smooth else SHARP
        self._passes = [_Pass(model, data, _Setting(camera, light, shift), self.skins) for shift in shifts]

    def sights(self, data: Any) -> Iterator[Sight]:
        """Yield the ray hits of each pass, for a pose with updated kinematics."""
        return (one.sight(data) for one in self._passes)

    def alone(self, data: Any, geom: int) -> int:
        """Return the number of rays that would hit a geom if it were the only geom in the scene."""
        eye = self._camera.position_m
        return sum(int((cast(self._model, data, eye, one.rays, [geom])[0] >= 0).sum()) for one in self._passes)


@dataclass(frozen=True, slots=True)
class _Setting:
    """Camera, light and ray shift, which is in pixels."""

    camera: PinholeCamera
    light: Light
    shift: tuple[float, float]


class _Pass:
    """One ray per pixel. ``_still`` contains the geoms that are fixed to the world and are not apples."""

    def __init__(self, model: Any, data: Any, setting: _Setting, skins: Mapping[int, Skin]) -> None:
        light = setting.light
        self._model, self._skins, self._eye = model, skins, setting.camera.position_m
        self.rays = setting.camera.rays(*setting.shift)
        self._sun = (light.direction, light.ambient)
        self._lamp = LAMP_M * light.direction
        self._colors = linear(model.geom_rgba[:, :3])
        self._all = visible(model)
        is_still = (model.body_weldid[model.geom_bodyid[self._all]] == 0) & ~np.isin(self._all, list(skins))
        self._still, self._moving = self._all[is_still], self._all[~is_still]
        self._hits = cast(model, data, self._eye, self.rays, self._still)
        self._radiance = np.tile(linear(SKY), (len(self.rays), 1))
        seen = np.flatnonzero(self._hits[0] >= 0)
        hits = _of_rows(self._hits, seen)
        toward, reach, lit = self._lit_points(data, seen, hits, self._still)
        self._radiance[seen] = self._shade(data, seen, hits, lit)[0]
        # Only lit points can be in the shadow of a moving geom.
        self._bright, self._reach = seen[lit], reach[lit]
        self._from_eye, self._from_lamp = Bundle(self._eye, self.rays), Bundle(self._lamp, toward[lit])
        unlit = np.zeros(len(self._bright), np.bool_)
        self._dark = self._shade(data, self._bright, _of_rows(hits, lit), unlit)[0]

    def sight(self, data: Any) -> Sight:
        """Return all ray hits."""
        radiance, geom = self._radiance.copy(), self._hits[0].copy()
        kind = np.zeros(len(radiance), np.int8)
        self._darken(data, radiance)
        rows = self._from_eye.near(self._model, data, self._moving)
        still = _of_rows(self._hits, rows)
        hits = cast(self._model, data, self._eye, self.rays[rows], self._moving, still)
        changed = np.flatnonzero(hits[1] < still[1])
        rows, hits = rows[changed], _of_rows(hits, changed)
        _, _, lit = self._lit_points(data, rows, hits, self._all)
        geom[rows] = hits[0]
        radiance[rows], kind[rows] = self._shade(data, rows, hits, lit)
        return Sight(radiance, geom, kind)

    def _darken(self, data: Any, radiance: FloatArray) -> None:
        """Store the radiance of points of fixed geoms that are in the shadow of moving geoms."""
        rows = self._from_lamp.near(self._model, data, self._moving)
        first = cast(self._model, data, self._lamp, self._from_lamp.rays[rows], self._moving)[1]
        shadow = rows[first <= self._reach[rows] - TOUCH_M]
        radiance[self._bright[shadow]] = self._dark[shadow]

    def _points(self, rows: Any, hits: Hits) -> FloatArray:
        points: FloatArray = self._eye + self.rays[rows] * hits[1][:, None]
        return points

    def _lit_points(self, data: Any, rows: Any, hits: Hits, geoms: Any) -> tuple[FloatArray, FloatArray, Any]:
        """Return the unit vectors from the lamp to the hits of some rays, the distances, and whether the lamp's light
        reaches each hit.

        Points on the far side of a geom are considered lit only if they face the lamp.
        """
        away = self._points(rows, hits) - self._lamp
        reach = np.linalg.norm(away, axis=1)
        toward = away / reach[:, None]
        facing = np.einsum("ni,ni->n", hits[2], toward) < 0.0
        first = cast(self._model, data, self._lamp, toward, geoms)[1]
        return toward, reach, facing & (first > reach - TOUCH_M)

    def _shade(self, data: Any, rows: Any, hits: Hits, lit: Any) -> tuple[FloatArray, NDArray[np.int8]]:
        """Return the radiance and the skin type at the hits of some rays."""
        geom, points = hits[0], self._points(rows, hits)
        color = albedo(self._colors, self._model.geom_type, geom, points)
        kind = np.full(len(rows), NO_SKIN, np.int8)
        for number, skin in self._skins.items():
            own = np.flatnonzero(geom == number)
            if not len(own):
                continue
            away = points[own] - data.geom_xpos[number]
            # For a sphere, MuJoCo sets only the first size. For a sphere, only the direction of a point matters.
            size = self._model.geom_size[number]
            local = np.einsum("ni,ij->nj", away, data.geom_xmat[number].reshape(3, 3))
            color[own], kind[own] = _painted(skin, local / np.where(size > 0.0, size, size[0]))
        return shade(color, kind, hits[2], self.rays[rows], lit, self._sun), kind


def _of_rows(hits: Hits, rows: Any) -> Hits:
    geom, distance, normal = hits
    return geom[rows], distance[rows], normal[rows]


def _painted(skin: Skin, points: FloatArray) -> tuple[FloatArray, NDArray[np.int8]]:
    color, kind = np.empty((len(points), 3)), np.empty(len(points), np.int8)
    paint(skin, points, color, kind)
    return color, kind
