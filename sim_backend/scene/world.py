"""The simulated world: the arm, one cube, its stand and three bins, in MuJoCo.

The world takes joint efforts and gives joint positions and velocities; what lies between a goal and an
effort (the servo) is not its business. It knows no wall clock: `step` is one timestep, always.
World frame = base_link. Joint order is `World.joints` everywhere: that of the scene's actuators, the hand's last.

What a scene has: a root body `base_link`; a motor of the same name for each driven joint; a keyframe `ready`, and
perhaps `rest`; the freejoint and geom `cube`; the geoms `stand` and `cube_place`; a body `bin_A` and a site
`bin_A_inside` for each bin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import sub
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from hal.robot_description.link_meshes import link_meshes
from sim_backend.mechanics.backlash import motor_name, with_gaps
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.joint_gears import JointGears
from sim_backend.mechanics.plant import JointArrays
from sim_backend.mechanics.spread import NOMINAL, Spread
from sim_backend.scene.drawn_model import drawn_model

FloatArray = NDArray[np.float64]

SCENE: Final = Path(__file__).resolve().parents[2] / "urdf" / "scene.xml"
BINS: Final = ("A", "B", "C")
REST_M_S: Final = 0.01
REST_RAD_S: Final = 0.1
READY: Final = "ready"
"""The keyframe with the arm's ready pose, the hand open, and a cube on the stand."""
REST: Final = "rest"
"""The keyframe with the pose in which a limp arm lies; a scene without it begins at ready."""
OFF_STAND_M: Final = 0.002
"""With its middle so far beyond the stand's edges the cube would topple."""
JAMMED_KG_M2: Final = 1e8
"""The inertia of gears that are blocked: nothing moves it noticeably, and MuJoCo still solves."""
LIFTED_M: Final = 0.006
"""So much higher or lower than on the stand the cube lies on something else."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a body is in base_link: position (m) and orientation (unit quaternion, x y z w)."""

    position_m: tuple[float, float, float]
    quaternion_xyzw: tuple[float, float, float, float]


class World:
    """One arm at work. Deterministic: the same efforts give the same positions, bit for bit."""

    def __init__(
        self,
        scene: Path | None = None,
        initial_position: Sequence[float] | None = None,
        spread: Spread = NOMINAL,
        backlash: Mapping[str, float] | None = None,
    ) -> None:
        """Load the scene with the cube on the stand and the arm at rest at `initial_position`.

        `initial_position`: in the order of `joints` (rad, m); by default that of the keyframe `rest` or `ready`.
        `spread`: how this arm differs from the scene's. `backlash`: how far joints are free of their motors (rad, m).
        """
        self._gears: JointGears | None = None
        self._built_armature: dict[int, float] = {}
        """Of degrees of freedom that are blocked."""
        self._motors = {joint: motor_name(joint) for joint in backlash or {}}
        self._scene, self._gaps = scene or SCENE, backlash or {}
        self.model: Any = with_gaps(self._scene, self._gaps).compile()
        if spread.seed is not None:
            spread.vary(self.model)
            mujoco.mj_setConst(self.model, mujoco.MjData(self.model))  # what follows from the masses
        self.data: Any = mujoco.MjData(self.model)
        self.timestep_s = float(self.model.opt.timestep)
        self.joints: tuple[str, ...] = tuple(self.model.actuator(i).name for i in range(self.model.nu))
        self._find_joints()
        self._find_geoms()
        self.ready: FloatArray = self.model.key(READY).qpos[self._qpos]
        """The ready pose with the hand open, in the order of `joints`."""
        self.laid = True
        """Whether stand, bins and cube are there."""
        self._held: FloatArray | None = None
        """MuJoCo's positions while the arm is held, without the cube's."""
        self._place_arm(self._rest() if initial_position is None else initial_position)

    def _find_joints(self) -> None:
        """Look names up once: `position` and `velocity` are called in every step."""
        joints = [self.model.joint(name) for name in self.joints]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._qvel = np.array([joint.dofadr[0] for joint in joints])
        motors = [self.model.joint(self._motors.get(name, name)).dofadr[0] for name in self.joints]
        # A servo's encoder sits on its output shaft; what it feels of the speed, the back-EMF, is its motor's.
        self.arrays = JointArrays(
            self.data.qpos, self.data.qvel, self.data.ctrl, self._qpos.tolist(), motors, range(self.model.nu)
        )
        low, high = joints[-1].range
        self.hand_travel = float(high - low)
        """How far the hand's joint goes, rad or m."""
        cube = self.model.joint("cube")
        self._cube_qpos = slice(cube.qposadr[0], cube.qposadr[0] + 7)
        self._cube_qvel = slice(cube.dofadr[0], cube.dofadr[0] + 6)
        self._home: FloatArray = self.model.qpos0[self._cube_qpos].copy()

    @property
    def lies(self) -> bool:
        """Whether the scene has a pose of rest, in which the arm begins and lies without help."""
        return REST in [self.model.key(i).name for i in range(self.model.nkey)]

    def _rest(self) -> FloatArray:
        at_rest: FloatArray = self.model.key(REST).qpos[self._qpos] if self.lies else self.ready
        return at_rest

    def _find_geoms(self) -> None:
        arm = self.model.body("base_link").id
        self._of_arm = self.model.body_rootid[self.model.geom_bodyid] == arm
        self._cube_geom = self.model.geom("cube").id
        self._place_geom = self.model.geom("cube_place").id
        width, depth, _ = self.model.geom("stand").size
        self._on_stand_m = (float(width) + OFF_STAND_M, float(depth) + OFF_STAND_M, LIFTED_M)

    def _place_arm(self, position: Sequence[float] | FloatArray) -> None:
        self.data.qpos[self._qpos] = position
        self._place_followers()
        for joint, motor in self._motors.items():
            self.data.joint(motor).qpos = self.data.joint(joint).qpos
        mujoco.mj_forward(self.model, self.data)
        bodies = {f"bin_{name}": self.data.body(f"bin_{name}") for name in BINS}
        self._bin_poses = {name: _pose(body.xpos, body.xquat) for name, body in bodies.items()}
        sites = [(name, f"bin_{name}_inside") for name in BINS]
        self._insides = [
            (name, self.data.site(site).xpos.copy(), self.model.site(site).size.copy()) for name, site in sites
        ]

    def _place_followers(self) -> None:
        """Bring each joint that an equality couples to another, as a left finger is, to where the other has it."""
        model, qpos = self.model, self.data.qpos
        for row in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
            follower, leader = (int(model.jnt_qposadr[joint]) for joint in (model.eq_obj1id[row], model.eq_obj2id[row]))
            moved = qpos[leader] - model.qpos0[leader]
            qpos[follower] = model.qpos0[follower] + np.polynomial.polynomial.polyval(moved, model.eq_data[row, :5])

    @property
    def time_s(self) -> float:
        """Simulated time since the world was made, s."""
        return float(self.data.time)

    def position(self) -> FloatArray:
        """Joint positions, shape (n,): rad, or m where a joint is prismatic."""
        return self.arrays.position.take(self._qpos)

    def velocity(self) -> FloatArray:
        """Joint velocities, shape (n,): rad/s, or m/s."""
        return self.arrays.velocity.take(self._qvel)

    def fit_gears(self, gears: Mapping[str, Gears]) -> None:
        """Give joints the inertia and friction of these gears, in the joints' units; the others keep the scene's."""
        if gears:
            dofs = {int(self.model.joint(self._motors.get(name, name)).dofadr[0]): own for name, own in gears.items()}
            self._gears = JointGears(self.model, self.data, dofs, self._gears)

    def jam(self, joint: str) -> None:
        """Block the joint's gears: it stands still, whatever pulls at it, until ``free``."""
        for dof in self._dofs(joint):
            self._built_armature.setdefault(dof, float(self.model.dof_armature[dof]))
            self.model.dof_armature[dof] = JAMMED_KG_M2
            self.data.qvel[dof] = 0.0

    def free(self, joint: str) -> None:
        """Undo ``jam``."""
        for dof in self._dofs(joint):
            self.model.dof_armature[dof] = self._built_armature.pop(dof)

    def _dofs(self, joint: str) -> list[int]:
        """The degrees of freedom of a joint and, where it has backlash, of its motor."""
        return [int(self.model.joint(name).dofadr[0]) for name in {joint, self._motors.get(joint, joint)}]

    def load(self, joint: str, effort: float) -> None:
        """Pull at a joint with ``effort`` (N m, or N) more than before."""
        self.data.joint(joint).qfrc_applied += effort

    def hold_until_driven(self) -> None:
        """Hold an arm that begins in the air still until an effort acts on it, as a person holds it at power-on.

        An arm whose scene has the keyframe `rest` lies there without help.
        """
        if not self.lies:
            self._held = self.data.qpos.copy()

    def advance(self) -> None:
        """Advance by one timestep under the efforts that are in ``arrays``."""
        if self._gears is not None:
            self._gears.update()
        mujoco.mj_step(self.model, self.data)
        if self._held is not None:
            self._keep_still(self._held)

    def _keep_still(self, held: FloatArray) -> None:
        if self.data.ctrl.any() or self.data.qfrc_applied.any():
            self._held = None
            return
        at, cube = self.data.qpos, self._cube_qpos
        at[: cube.start], at[cube.stop :] = held[: cube.start], held[cube.stop :]
        self.data.qvel[: self._cube_qvel.start] = self.data.qvel[self._cube_qvel.stop :] = 0.0

    def step(self, effort: Sequence[float] | FloatArray) -> None:
        """Advance by one timestep under the given joint efforts, shape (n,): N m, or N."""
        self.data.ctrl[:] = effort
        self.advance()

    def poses(self) -> dict[str, Pose]:
        """Poses in base_link of "cube" and "bin_A", "bin_B", "bin_C" (a bin: the middle of its floor)."""
        cube = self.data.qpos[self._cube_qpos]
        return {"cube": _pose(cube[:3], cube[3:]), **self._bin_poses}

    def cube_at_rest(self) -> bool:
        """Whether the cube is still (lying, or held still)."""
        speed: list[float] = self.arrays.velocity[self._cube_qvel].tolist()  # NumPy takes longer for six
        return max(map(abs, speed[:3])) < REST_M_S and max(map(abs, speed[3:])) < REST_RAD_S

    def cube_bin(self) -> str | None:
        """The bin in which the cube lies at rest: "A", "B" or "C"; None if it moves or is in none.

        The cube on the stand is in no bin: the bins' insides end below the stand's top.
        """
        middle = self.data.qpos[self._cube_qpos][:3]
        inside = (name for name, box, size in self._insides if (np.abs(middle - box) < size).all())
        return next(inside, None) if self.cube_at_rest() else None

    def cube_on_stand(self) -> bool:
        """Whether the cube lies at rest on the stand."""
        place: list[float] = self.arrays.position[self._cube_qpos].tolist()  # NumPy takes longer for three
        apart = map(sub, place[:3], self._home.tolist())
        return all(abs(way) < reach for way, reach in zip(apart, self._on_stand_m, strict=True)) and self.cube_at_rest()

    def cube_touched(self) -> bool:
        """Whether the arm touches the cube."""
        pairs = self.data.contact.geom
        return bool(((pairs == self._cube_geom).any(axis=1) & self._of_arm[pairs].any(axis=1)).any())

    def stand_free(self) -> bool:
        """Whether no part of the arm is where a fresh cube would be laid (and 2 mm around it)."""
        arm = np.flatnonzero(self._of_arm)
        distance = (mujoco.mj_geomDistance(self.model, self.data, geom, self._place_geom, 0.01, None) for geom in arm)
        return all(gap > 0.0 for gap in distance)

    def clear_table(self) -> None:
        """Take stand, bins and cube away: nothing is in the arm's way but the table."""
        model, things = self.model, self._things()
        self._cleared = model.geom_contype[things].copy(), model.geom_conaffinity[things].copy()
        model.geom_contype[things] = model.geom_conaffinity[things] = 0
        model.geom_rgba[things, 3] = 0.0
        model.body_gravcomp[model.body("cube").id] = 1.0
        self.laid = False

    def lay_table(self) -> None:
        """Bring back what ``clear_table`` took away, with the cube on its stand."""
        if self.laid:
            return
        model, things = self.model, self._things()
        model.geom_contype[things], model.geom_conaffinity[things] = self._cleared
        model.geom_rgba[things, 3] = 1.0
        model.body_gravcomp[model.body("cube").id] = 0.0
        self.laid = True
        self.feed_cube()

    def _things(self) -> NDArray[np.int64]:
        """The geometries on the table."""
        return np.array([g for g in np.flatnonzero(~self._of_arm) if g != self.model.geom("table").id])

    def feed_cube(self) -> None:
        """Lay the cube at rest in the middle of the stand."""
        self.data.qpos[self._cube_qpos] = self._home
        self.data.qvel[self._cube_qvel] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def configuration(self) -> FloatArray:
        """All that a picture needs: a copy of MuJoCo's positions of arm and cube."""
        everything: FloatArray = self.data.qpos.copy()
        return everything

    def drawn_model(self) -> Any:
        """A model of the same positions for pictures: with the real shapes of the arm's links, where it has them."""
        model = drawn_model(with_gaps(self._scene, self._gaps), link_meshes(self._scene.parent))
        model.geom_rgba[model.geom_type != mujoco.mjtGeom.mjGEOM_MESH] = self.model.geom_rgba
        return model

    def cube_height_m(self, configuration: FloatArray) -> float:
        """Height of the cube's middle above the table in a `configuration`."""
        return float(configuration[self._cube_qpos][2])


def _pose(position: FloatArray, quaternion_wxyz: FloatArray) -> Pose:
    """MuJoCo says w first; everything else here says w last."""
    x, y, z = (float(value) for value in position)
    qw, qx, qy, qz = (float(value) for value in quaternion_wxyz)
    return Pose((x, y, z), (qx, qy, qz, qw))
