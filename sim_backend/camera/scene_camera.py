"""Scene camera: images of the arm and the apple, rendered from world feed messages."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from hal.hal_errors import ArmFileError
from sim_backend.apples.apple import Apple, draw_apple
from sim_backend.apples.spheres import resize
from sim_backend.camera.light import Light
from sim_backend.camera.pinhole import FloatArray, PinholeCamera
from sim_backend.camera.sensor import Film, Sensor
from sim_backend.camera.skin import skin_of
from sim_backend.camera.truth import AppleTruth, truth_of
from sim_backend.camera.view import FixedView, Sight, mean_radiance
from sim_backend.scene.picture import Picture
from sim_backend.scene.world import World, place_followers

CAMERA: Final = "camera"
"""Name of the camera in the scene."""
MOVED: Final = 1e-4
"""Change of a joint (rad, m) or of the apple's pose that requires a new image. The noise is new in every image."""
FIRST_APPLE: Final = Apple(diameter_mm=50.0, height=1.0, red_share=0.5, spots=(), seed=0)
"""Apple that determines the skin of the sphere until the first message of the feed arrives."""


class SceneCamera:
    """Camera of one scene with apples. Links are rendered as the simple shapes of the scene, which are fast to draw."""

    def __init__(self, scene: Path, light: Light | None = None, sensor: Sensor | None = None, seed: int = 0) -> None:
        """Prepare the camera.

        Args:
            scene: The MuJoCo file, which must contain apples and a camera named ``camera``.
            light: Lighting of the scene; by default, indoor daylight.
            sensor: Sensor settings.
            seed: Seed of the noise.

        Raises:
            ArmFileError: The scene has no camera or no apples.
        """
        world = World(scene, apples=seed)
        self._model, self._data = world.model, world.data
        if CAMERA not in [self._model.cam(i).name for i in range(self._model.ncam)]:
            raise ArmFileError(f'{scene}: the scene has no camera: add <camera name="{CAMERA}" .../> to <worldbody>')
        assert world.cell is not None and world.cell.tray is not None
        self.diameters_mm = world.cell.tray.diameters_mm
        """Smallest and largest diameter of the apples, in millimeters."""
        self._light, self._seed, self._taken = light or Light(), seed, 0
        self.camera = PinholeCamera.of(self._model, self._data, CAMERA)
        self._geom = int(self._model.geom("cube").id)
        self._at = slice(int(self._model.joint("cube").qposadr[0]), int(self._model.joint("cube").qposadr[0]) + 7)
        self._view = FixedView(self._model, self._data, self.camera, self._light, {self._geom: skin_of(FIRST_APPLE)})
        self._film = Film(sensor or Sensor(), self.camera.width, self.camera.height)
        mujoco.mj_kinematics(self._model, self._data)
        x, y, z = (float(value) for value in self._data.geom("stand").xpos)
        self.stand_m = (x, y, z + float(self._model.geom("stand").size[2]))
        """Center of the top surface of the stand in world coordinates, in m."""
        self._apple: Apple | None = None
        self._cast_at: FloatArray | None = None
        self._sights: list[Sight] = []

    def see(self, publication: Mapping[str, Any]) -> None:
        """Update the world state from a message of the world feed (``sim_backend.scene.world_feed``)."""
        for joint, position in publication["joints"].items():
            self._data.joint(joint).qpos = position
        place_followers(self._model, self._data.qpos)
        pose = publication["poses"]["cube"]
        x, y, z, w = pose["quaternion_xyzw"]
        self._data.qpos[self._at] = *pose["position_m"], w, x, y, z
        apple = publication.get("apple")
        if apple is not None and (self._apple is None or apple["seed"] != self._apple.seed):
            self._apple = replace(draw_apple(apple["seed"]), diameter_mm=apple["diameter_mm"], height=1.0)
            resize(self._model, 0.0005 * self._apple.diameter_mm)
            self._view.skins[self._geom] = skin_of(self._apple)
            self._cast_at = None

    def picture(self) -> Picture:
        """Return an image (480, 640, 3) of the state stored by ``see``."""
        if self._cast_at is None or np.abs(self._data.qpos - self._cast_at).max() > MOVED:
            mujoco.mj_kinematics(self._model, self._data)
            self._sights = list(self._view.sights(self._data))
            self._cast_at = self._data.qpos.copy()
        self._taken += 1
        return self._film.picture(mean_radiance(self._sights), self._light, self._seed * 1_000_003 + self._taken)

    def truth(self) -> AppleTruth | None:
        """Return the true state of the apple in the last image, or None if no image has contained an apple yet."""
        if self._apple is None or not self._sights:
            return None
        return truth_of(self._view, self.camera, self._data, self._sights, self._geom, self._apple.diameter_mm)
