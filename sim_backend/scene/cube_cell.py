"""Workcell of the pick-and-place job in the simulated world: one cube, its stand and three bins.

A scene must have either all elements of the cell or none of them: the freejoint and geom `cube`, the geoms `stand` and
`cube_place`, and for each bin a body `bin_A` and a site `bin_A_inside`. In a scene with several arms, each arm can have
its own cell, whose element names begin with the arm's prefix.
"""

from dataclasses import dataclass
from operator import sub
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim_backend.apples.apple import Apple
from sim_backend.apples.spheres import apple_of_tray, resize
from sim_backend.arm_names import arm_prefixes, part_name, prefix_of
from sim_backend.mechanics.plant import JointArrays

FloatArray = NDArray[np.float64]

BINS: Final = ("A", "B", "C")
CUBE: Final = "cube"
REST_M_S: Final = 0.01
REST_RAD_S: Final = 0.1
OFF_STAND_M: Final = 0.002
"""Maximum distance of the cube's center beyond the edges of the stand, in meters. A cube farther out would topple."""
LIFTED_M: Final = 0.006
"""Minimum height difference at which the cube is considered lifted from the stand."""


@dataclass(frozen=True, slots=True)
class BodyPose:
    """Pose of a body in base_link: position (m) and orientation (unit quaternion, x y z w)."""

    position_m: tuple[float, float, float]
    quaternion_xyzw: tuple[float, float, float, float]


def cell_prefixes(model: Any) -> list[str]:
    """Return the prefix of each arm that has a cube. An arm with a cube needs a complete cell."""
    joints = [model.joint(i).name for i in range(model.njnt)]
    return [prefix for prefix in arm_prefixes(model) if f"{prefix}{CUBE}" in joints]


@dataclass(frozen=True, slots=True)
class Tray:
    """Apples that replace the cube and appear on the stand one after another."""

    seed: int
    """Random seed for all apples."""
    diameters_mm: tuple[float, float]
    """Smallest and largest apple diameters, in millimeters."""


class CubeCell:
    """The cube, the stand and the bins in a world. With a tray, apples replace the cube."""

    def __init__(
        self,
        model: Any,
        data: Any,
        arrays: JointArrays,
        of_arm: NDArray[np.bool_],
        tray: Tray | None = None,
        prefix: str = "",
    ) -> None:
        """Find the elements of the cell.

        Args:
            model: The compiled scene.
            data: State of the compiled scene.
            arrays: Positions and velocities of the scene.
            of_arm: Whether each geom belongs to an arm, shape (ngeom,).
            tray: Apples that replace the cube.
            prefix: Prefix of all names of the cell, in a scene with several arms.
        """
        self.tray = tray
        self.prefix = prefix
        self.apple: Apple | None = None
        """Apple that is being sorted; None for a cube."""
        self.fed = 0
        """Number of cubes or apples before the current one."""
        self._model, self._data, self._arrays, self._of_arm = model, data, arrays, of_arm
        self.laid = True
        """Whether the stand, the bins and the cube are present."""
        cube = model.joint(self.name(CUBE))
        self.qpos = slice(cube.qposadr[0], cube.qposadr[0] + 7)
        self.qvel = slice(cube.dofadr[0], cube.dofadr[0] + 6)
        self.home: FloatArray = model.qpos0[self.qpos].copy()
        self._cube_geom = model.geom(self.name(CUBE)).id
        self._cube_body = int(model.geom_bodyid[self._cube_geom])
        self._place_geom = model.geom(self.name("cube_place")).id
        width, depth, _ = model.geom(self.name("stand")).size
        self._on_stand_m = (float(width) + OFF_STAND_M, float(depth) + OFF_STAND_M, LIFTED_M)
        if tray is not None:
            mujoco.mj_kinematics(model, data)
            stand = data.geom(self.name("stand"))
            self._stand_m = float(stand.xpos[2] + model.geom(self.name("stand")).size[2])
            self._place_apple(tray)

    def name(self, part: str) -> str:
        """Return the scene name of one of this cell's elements, such as ``left_cube`` for ``cube``."""
        return f"{self.prefix}{part}"

    def locate(self) -> None:
        """Store the bin poses. Call this method when the kinematics are up to date."""
        bodies = [self._data.body(self.name(f"bin_{name}")) for name in BINS]
        self._bin_poses = {body.name: _pose(body.xpos, body.xquat) for body in bodies}
        sites = [(name, self.name(f"bin_{name}_inside")) for name in BINS]
        self._insides = [
            (name, self._data.site(site).xpos.copy(), self._model.site(site).size.copy()) for name, site in sites
        ]

    def poses(self) -> dict[str, BodyPose]:
        """Return the poses in base_link of "cube", "bin_A", "bin_B" and "bin_C", keyed by their names in the scene.

        The pose of a bin is defined at the center of its floor.
        """
        cube = self._data.qpos[self.qpos]
        return {self.name(CUBE): _pose(cube[:3], cube[3:]), **self._bin_poses}

    def cube_at_rest(self) -> bool:
        """Return whether the cube is at rest, either on a surface or in the hand."""
        speed: list[float] = self._arrays.velocity[self.qvel].tolist()  # NumPy would be slower for six values.
        return max(map(abs, speed[:3])) < REST_M_S and max(map(abs, speed[3:])) < REST_RAD_S

    def cube_bin(self) -> str | None:
        """Return the bin in which the cube is at rest ("A", "B" or "C"), or None if the cube is moving or not in a bin.

        A cube on the stand is not in a bin, because the interior of each bin ends below the top of the stand.
        """
        middle = self._data.qpos[self.qpos][:3]
        inside = (name for name, box, size in self._insides if (np.abs(middle - box) < size).all())
        return next(inside, None) if self.cube_at_rest() else None

    def cube_on_stand(self) -> bool:
        """Return whether the cube is at rest on the stand."""
        place: list[float] = self._arrays.position[self.qpos].tolist()  # NumPy would be slower for three values.
        apart = map(sub, place[:3], self.home.tolist())
        return all(abs(way) < reach for way, reach in zip(apart, self._on_stand_m, strict=True)) and self.cube_at_rest()

    def cube_touched(self) -> bool:
        """Return whether the arm touches the cube."""
        pairs = self._data.contact.geom
        return bool(((pairs == self._cube_geom).any(axis=1) & self._of_arm[pairs].any(axis=1)).any())

    def stand_free(self) -> bool:
        """Return whether the arm is at least 2 mm away from the place for a new cube."""
        model, data, place = self._model, self._data, self._place_geom
        arm = np.flatnonzero(self._of_arm)
        distance = (mujoco.mj_geomDistance(model, data, geom, place, 0.01, None) for geom in arm)
        return all(gap > 0.0 for gap in distance)

    def clear(self) -> None:
        """Remove the stand, the bins and the cube, so that only the table remains."""
        model, things = self._model, self._things()
        self._cleared = model.geom_contype[things].copy(), model.geom_conaffinity[things].copy()
        model.geom_contype[things] = model.geom_conaffinity[things] = 0
        model.geom_rgba[things, 3] = 0.0
        model.body_gravcomp[self._cube_body] = 1.0
        self.laid = False

    def lay(self) -> None:
        """Restore the objects removed by ``clear``, with the cube on its stand."""
        if self.laid:
            return
        model, things = self._model, self._things()
        model.geom_contype[things], model.geom_conaffinity[things] = self._cleared
        model.geom_rgba[things, 3] = 1.0
        model.body_gravcomp[self._cube_body] = 0.0
        self.laid = True
        self.feed_cube()

    def _things(self) -> NDArray[np.int64]:
        """Return the geoms on the table that belong to this cell."""
        table, prefixes = self._model.geom("table").id, arm_prefixes(self._model)
        things = [g for g in np.flatnonzero(~self._of_arm).tolist() if g != table]
        return np.array([g for g in things if prefix_of(part_name(self._model, g), prefixes) == self.prefix])

    def feed_cube(self) -> None:
        """Place the cube or the next apple at rest in the center of the stand."""
        self.fed += 1
        if self.tray is not None:
            self._place_apple(self.tray)
        self._data.qpos[self.qpos] = self.home
        self._data.qvel[self.qvel] = 0.0
        mujoco.mj_forward(self._model, self._data)

    def _place_apple(self, tray: Tray) -> None:
        """Set the size of the sphere to that of the next apple, and place it on the stand."""
        self.apple = apple_of_tray(tray.seed, self.fed, tray.diameters_mm)
        radius_m = 0.0005 * self.apple.diameter_mm
        resize(self._model, radius_m)
        turn = np.random.default_rng((self.apple.seed, 5)).normal(size=4)
        self.home[2] = self._stand_m + radius_m
        self.home[3:] = turn / np.linalg.norm(turn)
        self._data.qpos[self.qpos] = self.home


def _pose(position: FloatArray, quaternion_wxyz: FloatArray) -> BodyPose:
    """Convert a MuJoCo pose, whose quaternion order is w, x, y, z. Everywhere else in this project, w comes last."""
    x, y, z = (float(value) for value in position)
    qw, qx, qy, qz = (float(value) for value in quaternion_wxyz)
    return BodyPose((x, y, z), (qx, qy, qz, qw))
