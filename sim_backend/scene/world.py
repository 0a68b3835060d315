"""Simulated world in MuJoCo: one or more arms, each with a cube, its stand and three bins if the scene has them.

The world takes joint efforts and returns joint positions and velocities. The world does not model servos, which convert
goals to efforts. The world has no wall clock: `step` always advances it by one timestep. The origin of the world frame
is at the arm's base. Joints are always in the order of `World.joints`, which is the order of the scene's actuators. The
last joint of an arm is the hand's joint.

A scene needs one actuator for each driven joint, with the same name as the joint. The scene may have the keyframes
`ready` and `rest`, and all elements that `sim_backend.scene.cube_cell` lists.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from hal.robot_description.link_meshes import link_meshes
from sim_backend.apples.apple import Apple
from sim_backend.apples.spheres import apple_diameters_mm, replace_cube
from sim_backend.arm_names import arm_prefixes, prefix_of
from sim_backend.line.spread import NOMINAL, Spread
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.joint_gears import JointGears
from sim_backend.mechanics.plant import JointArrays
from sim_backend.scene.backlash import motor_name, with_gaps
from sim_backend.scene.cube_cell import CUBE, BodyPose, CubeCell, FloatArray, Tray, cell_prefixes
from sim_backend.scene.drawn_model import drawn_model

SCENE: Final = Path(__file__).resolve().parents[2] / "urdf" / "scene.xml"
READY: Final = "ready"
"""Keyframe with the ready pose, an open hand and a cube on the stand. If this keyframe is missing, the initial pose of
the scene is used."""
REST: Final = "rest"
"""Keyframe with the pose in which a limp arm is at rest. If this keyframe is missing, the arm starts in the ready
pose."""
JAMMED_KG_M2: Final = 1e8
"""Inertia of blocked gears. This value is large enough to prevent any noticeable motion, and small enough for MuJoCo to
solve the equations."""


class World:
    """World of one or more arms. The world is deterministic: the same efforts produce the same positions, bit for
    bit."""

    def __init__(
        self,
        scene: Path | None = None,
        initial_position: Sequence[float] | None = None,
        spread: Spread = NOMINAL,
        backlash: Mapping[str, float] | None = None,
        apples: int | None = None,
    ) -> None:
        """Load the scene with the cube on the stand and the arm at rest.

        Args:
            scene: The MuJoCo file; by default, this project's scene.
            initial_position: Joint positions in the order of `joints` (rad, m); by default, those of the keyframe
                `rest` or `ready`.
            spread: Deviations of this arm from the scene.
            backlash: Free travel of joints relative to their motors (rad, m).
            apples: Random seed for the apples that replace the cube; None to use the cube.
        """
        self._gears: JointGears | None = None
        self._built_armature: dict[int, float] = {}
        """Original armature of blocked degrees of freedom."""
        self._loads, self._pushes = defaultdict[str, float](float), defaultdict[str, float](float)
        """External load on each joint, and effort of a person's hand on it, in N m or N."""
        self._motors = {joint: motor_name(joint) for joint in backlash or {}}
        self._scene, self._gaps = scene or SCENE, backlash or {}
        self._tray: Tray | None = None
        spec: Any = with_gaps(self._scene, self._gaps)
        if apples is not None:
            self._tray = Tray(apples, apple_diameters_mm(spec, self._scene))
            replace_cube(spec, self._tray.diameters_mm)
        self.model: Any = spec.compile()
        if spread.seed is not None:
            spread.vary(self.model)
            mujoco.mj_setConst(self.model, mujoco.MjData(self.model))  # Update the constants that depend on masses.
        self.data: Any = mujoco.MjData(self.model)
        self.timestep_s = float(self.model.opt.timestep)
        self.joints: tuple[str, ...] = tuple(self.model.actuator(i).name for i in range(self.model.nu))
        self._find_joints()
        self._arm_geoms = self._of_arm()
        self.cells = tuple(self._cell(prefix) for prefix in cell_prefixes(self.model))
        """Cells with a cube, its stand and its bins; empty if the scene has only the arm."""
        cubes = [cell.name(CUBE) for cell in self.cells]
        self._cube_geoms = np.array([self.model.geom(geom).name in cubes for geom in range(self.model.ngeom)])
        first = self.model.key(READY).qpos if READY in self._keyframes() else self.model.qpos0
        self.ready: FloatArray = first[self._qpos]
        """The ready pose with an open hand, in the order of `joints`."""
        self._held: FloatArray | None = None
        """MuJoCo's positions, except those of the cube, while the arm is held; otherwise None."""
        self._place_arm(self._rest() if initial_position is None else initial_position)

    def _cell(self, prefix: str) -> CubeCell:
        return CubeCell(self.model, self.data, self.arrays, self._arm_geoms, self._tray, prefix)

    @property
    def cell(self) -> CubeCell | None:
        """Cell of the first arm that has a cell; None if no arm has a cell."""
        return self.cells[0] if self.cells else None

    def joints_of(self, cell: CubeCell) -> NDArray[np.int64]:
        """Return the indices in `joints` of the arm to which a cell belongs. The hand's joint is the last."""
        prefixes = arm_prefixes(self.model)
        return np.array([i for i, joint in enumerate(self.joints) if prefix_of(joint, prefixes) == cell.prefix])

    def _find_joints(self) -> None:
        """Look up all name indices once, because `position` and `velocity` are called in every step."""
        joints = [self.model.joint(name) for name in self.joints]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._qvel = np.array([joint.dofadr[0] for joint in joints])
        motors = [self.model.joint(self._motors.get(name, name)).dofadr[0] for name in self.joints]
        # A servo's encoder is on its output shaft, but the back-EMF depends on the motor speed.
        self.arrays = JointArrays(
            self.data.qpos, self.data.qvel, self.data.ctrl, self._qpos.tolist(), motors, range(self.model.nu)
        )
        self.travel = np.array([float(joint.range[1] - joint.range[0]) for joint in joints])
        """Range of motion of each joint, in rad or m."""

    @property
    def lies(self) -> bool:
        """Whether the scene has a rest pose, in which the arm starts and needs no support."""
        return REST in self._keyframes()

    @property
    def laid(self) -> bool:
        """Whether stand, bins and cube are present."""
        return bool(self.cells) and all(cell.laid for cell in self.cells)

    def _keyframes(self) -> list[str]:
        return [self.model.key(i).name for i in range(self.model.nkey)]

    def _rest(self) -> FloatArray:
        at_rest: FloatArray = self.model.key(REST).qpos[self._qpos] if self.lies else self.ready
        return at_rest

    def _of_arm(self) -> Any:
        """Return whether each geom belongs to an arm, shape (ngeom,)."""
        arms = self.model.body_rootid[[self.model.joint(joint).bodyid[0] for joint in self.joints]]
        return np.isin(self.model.body_rootid[self.model.geom_bodyid], arms)

    def _place_arm(self, position: Sequence[float] | FloatArray) -> None:
        self.data.qpos[self._qpos] = position
        place_followers(self.model, self.data.qpos)
        for joint, motor in self._motors.items():
            self.data.joint(motor).qpos = self.data.joint(joint).qpos
        mujoco.mj_forward(self.model, self.data)
        for cell in self.cells:
            cell.locate()

    @property
    def time_s(self) -> float:
        """Simulated time since the world was created, in seconds."""
        return float(self.data.time)

    def position(self) -> FloatArray:
        """Return the joint positions, shape (n,), in rad, or in m for prismatic joints."""
        return self.arrays.position.take(self._qpos)

    def velocity(self) -> FloatArray:
        """Return the joint velocities, shape (n,), in rad/s or m/s."""
        return self.arrays.velocity.take(self._qvel)

    def fit_gears(self, gears: Mapping[str, Gears]) -> None:
        """Apply the inertia and friction of these gears, in joint units. Other joints keep the values of the scene."""
        if gears:
            dofs = {int(self.model.joint(self._motors.get(name, name)).dofadr[0]): own for name, own in gears.items()}
            self._gears = JointGears(self.model, self.data, dofs, self._gears)

    def jam(self, joint: str) -> None:
        """Block the joint's gears. Until ``free`` is called, the joint does not move under any load."""
        for dof in self._dofs(joint):
            self._built_armature.setdefault(dof, float(self.model.dof_armature[dof]))
            self.model.dof_armature[dof] = JAMMED_KG_M2
            self.data.qvel[dof] = 0.0

    def free(self, joint: str) -> None:
        """Undo ``jam``."""
        for dof in self._dofs(joint):
            self.model.dof_armature[dof] = self._built_armature.pop(dof)

    def _dofs(self, joint: str) -> list[int]:
        """Return the degrees of freedom of a joint and, if the joint has backlash, of its motor."""
        return [int(self.model.joint(name).dofadr[0]) for name in {joint, self._motors.get(joint, joint)}]

    def load(self, joint: str, effort: float) -> None:
        """Add ``effort`` (N m, or N) to the external load on a joint."""
        self._loads[joint] += effort
        self.push(joint, self._pushes[joint])

    def push(self, joint: str, effort: float) -> None:
        """Set the effort (N m, or N) of a person's hand on a joint. The effort acts in addition to the load."""
        self._pushes[joint] = effort
        self.data.joint(joint).qfrc_applied = self._loads[joint] + effort

    def hold_until_driven(self) -> None:
        """Hold the arm still until an effort acts on it, as a person supports a real arm at power-on.

        An arm whose scene has the keyframe `rest` needs no support.
        """
        if not self.lies:
            self._held = self.data.qpos.copy()

    def advance(self) -> None:
        """Advance by one timestep, applying the efforts in ``arrays``."""
        if self._gears is not None:
            self._gears.update()
        mujoco.mj_step(self.model, self.data)
        if self._held is not None:
            self._keep_still(self._held)

    def _keep_still(self, held: FloatArray) -> None:
        if self.data.ctrl.any() or self.data.qfrc_applied.any():
            self._held = None
            return
        still, slow = held.copy(), np.zeros_like(self.data.qvel)
        for cell in self.cells:
            still[cell.qpos], slow[cell.qvel] = self.data.qpos[cell.qpos], self.data.qvel[cell.qvel]
        self.data.qpos[:], self.data.qvel[:] = still, slow

    def step(self, effort: Sequence[float] | FloatArray) -> None:
        """Advance by one timestep, applying the given joint efforts, shape (n,), in N m or N."""
        self.data.ctrl[:] = effort
        self.advance()

    def poses(self) -> dict[str, BodyPose]:
        """Return the object poses of all cells, keyed by name; empty if there are no cells."""
        return {name: pose for cell in self.cells for name, pose in cell.poses().items()}

    def cube_bin(self, joint: str = "") -> str | None:
        """Return the bin in which a cube is at rest, or None if the cube is moving, is not in a bin, or does not exist.

        If the robot has several arms, ``joint`` is a joint of the arm whose cell contains the cube.
        """
        prefix = prefix_of(joint, arm_prefixes(self.model))
        cell = next((cell for cell in self.cells if cell.prefix == prefix), self.cell)
        return None if cell is None else cell.cube_bin()

    def cube_bins(self) -> dict[str, str | None]:
        """Return the bin in which each cube is at rest, keyed by cube name; None if the cube is moving or is not in a
        bin."""
        return {cell.name(CUBE): cell.cube_bin() for cell in self.cells}

    def arm_contacts(self) -> set[str]:
        """Return the arm's contacts with anything except the cube, each as "link and object"."""
        pairs = self.data.contact.geom
        of_arm = self._arm_geoms[pairs]
        touching = of_arm.any(axis=1) & ~self._cube_geoms[pairs].any(axis=1)
        return {self._contact_name(pair, arms) for pair, arms in zip(pairs[touching], of_arm[touching], strict=True)}

    def _contact_name(self, pair: NDArray[np.int32], of_arm: NDArray[np.bool_]) -> str:
        link, other = pair if of_arm[0] else pair[::-1]
        body = self.model.body(self.model.geom_bodyid[other]).name
        other_name = self.model.geom(other).name if body == "world" else body
        return f"{self.model.body(self.model.geom_bodyid[link]).name} and {other_name}"

    @property
    def apple(self) -> Apple | None:
        """The apple that is being sorted, if apples replace the cube."""
        return None if self.cell is None else self.cell.apple

    def clear_table(self) -> None:
        """Remove stands, bins and cubes, if there are any."""
        for cell in self.cells:
            cell.clear()

    def lay_table(self) -> None:
        """Restore the objects removed by ``clear_table``."""
        for cell in self.cells:
            cell.lay()

    def configuration(self) -> FloatArray:
        """Return a copy of the MuJoCo positions of the arm and the cube. No other data is needed to render an image."""
        everything: FloatArray = self.data.qpos.copy()
        return everything

    def drawn_model(self) -> Any:
        """Return a model for rendering that uses the same positions, and the real link shapes if they exist."""
        spec = with_gaps(self._scene, self._gaps)
        if self._tray is not None:
            replace_cube(spec, self._tray.diameters_mm)
        model = drawn_model(spec, link_meshes(self._scene.parent))
        model.geom_rgba[model.geom_type != mujoco.mjtGeom.mjGEOM_MESH] = self.model.geom_rgba
        return model

    def cube_height_m(self, configuration: FloatArray) -> float:
        """Return the height of the cube's center above the table in a `configuration`; 0 without a cube."""
        return 0.0 if self.cell is None else float(configuration[self.cell.qpos][2])


def place_followers(model: Any, qpos: FloatArray) -> None:
    """Move each joint that is coupled to another joint by an equality, such as a second finger, to its coupled
    position."""
    for row in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        follower, leader = (int(model.jnt_qposadr[joint]) for joint in (model.eq_obj1id[row], model.eq_obj2id[row]))
        moved = qpos[leader] - model.qpos0[leader]
        qpos[follower] = model.qpos0[follower] + np.polynomial.polynomial.polyval(moved, model.eq_data[row, :5])
