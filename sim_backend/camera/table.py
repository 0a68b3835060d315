"""Render images of apples on a table, without an arm, by calling ``render``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import mujoco
import numpy as np

from sim_backend.apples.apple import DIAMETERS_MM, Apple, draw_apple
from sim_backend.camera.light import Light
from sim_backend.camera.pinhole import FloatArray, PinholeCamera
from sim_backend.camera.sensor import Film, Sensor
from sim_backend.camera.skin import skin_of
from sim_backend.camera.truth import AppleTruth, truth_of
from sim_backend.camera.view import FixedView, mean_radiance
from sim_backend.scene.picture import Picture

GRAY: Final = (0.80, 0.80, 0.78)
AREA_M: Final = (0.16, 0.12)
"""Half sizes, along x and y, of the area in which apples are placed, in meters."""
GAP_M: Final = 0.005
"""Minimum distance between two apples, in meters."""
TRIES: Final = 1000
EYE_M: Final = np.array([-0.25, 0.0, 0.55])


@dataclass(frozen=True, slots=True)
class LyingApple:
    """An apple on the table. The table is the plane z = 0."""

    apple: Apple
    x_m: float
    y_m: float
    turn: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Orientation as a quaternion in the order w, x, y, z."""


@dataclass(frozen=True, slots=True)
class AppleTable:
    """The table with everything on it. The table is 0.6 m in front of the camera that ``table_camera`` returns."""

    apples: Sequence[LyingApple]
    rgb: tuple[float, float, float] = GRAY
    """Color of the table, in sRGB from 0 to 1."""
    sensor: Sensor = field(default_factory=Sensor)
    """Settings of the camera's sensor."""
    smooth: bool = True
    """Whether to smooth edges. Rendering images with smooth edges takes four times as long."""


def table_camera(focal_px: float = 600.0) -> PinholeCamera:
    """Return a camera that looks down at the center of the table from a distance of 0.6 m."""
    return PinholeCamera.looking_at(np.zeros(3), EYE_M, focal_px)


def draw_tray(seed: int, count: int, gap_m: float = GAP_M) -> list[LyingApple]:
    """Return random apples at random places on the table. The same seed returns the same apples.

    Raises ValueError if this number of apples does not fit on the table.
    """
    random = np.random.default_rng((seed, 4))
    apples = [draw_apple(int(number), DIAMETERS_MM) for number in random.integers(1 << 31, size=count)]
    lying: list[LyingApple] = []
    for _ in range(TRIES):
        if len(lying) == count:
            return lying
        apple = apples[len(lying)]
        x_m, y_m = (float(value) for value in random.uniform(-1.0, 1.0, 2) * AREA_M)
        turn = random.normal(size=4)
        w, x, y, z = (float(value) for value in turn / np.linalg.norm(turn))
        if all(_apart(apple, x_m, y_m, other) > gap_m for other in lying):
            lying.append(LyingApple(apple, x_m, y_m, (w, x, y, z)))
    raise ValueError(f"{count} apples with gaps of {gap_m} m do not fit on the table: request fewer apples")


def render(table: AppleTable, camera: PinholeCamera, light: Light, seed: int) -> tuple[Picture, list[AppleTruth]]:
    """Return an image (height, width, 3) of a table, and the true values of each apple, ordered as in ``table.apples``.

    Args:
        table: The table and its apples.
        camera: The camera, which must be above the table.
        light: The light.
        seed: Seed of the noise. The same arguments return the same image.
    """
    model, geoms = _model(table)
    data: Any = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    skins = {geom: skin_of(lying.apple) for geom, lying in zip(geoms, table.apples, strict=True)}
    view = FixedView(model, data, camera, light, skins, table.smooth)
    sights = list(view.sights(data))
    picture = Film(table.sensor, camera.width, camera.height).picture(mean_radiance(sights), light, seed)
    truth = [
        truth_of(view, camera, data, sights, geom, lying.apple.diameter_mm)
        for geom, lying in zip(geoms, table.apples, strict=True)
    ]
    return picture, truth


def _apart(apple: Apple, x_m: float, y_m: float, other: LyingApple) -> float:
    between_m = float(np.hypot(x_m - other.x_m, y_m - other.y_m))
    return between_m - 0.0005 * (apple.diameter_mm + other.apple.diameter_mm)


def _model(table: AppleTable) -> tuple[Any, list[int]]:
    """Return a model of the table and its apple geoms."""
    spec: Any = mujoco.MjSpec()
    spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.1], rgba=[*table.rgb, 1.0]
    )
    for number, lying in enumerate(table.apples):
        radii_m = np.array(lying.apple.radii_m)
        spec.worldbody.add_geom(
            name=f"apple{number}",
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=radii_m,
            quat=lying.turn,
            pos=[lying.x_m, lying.y_m, _height_m(radii_m, lying.turn)],
        )
    model: Any = spec.compile()
    return model, [int(model.geom(f"apple{number}").id) for number in range(len(table.apples))]


def _height_m(radii_m: FloatArray, turn: tuple[float, float, float, float]) -> float:
    """Return the height of the center of an ellipsoid that is resting on the table."""
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, np.array(turn))
    return float(np.linalg.norm(radii_m * axes.reshape(3, 3)[2]))
