"""Plant driven by the servo shafts: the simulated arm or a test bench. All values are in SI units.

A servo knows only its own shaft. A ``Coupling`` defines which joint the shaft moves, and how. Forces are converted with
the inverse ratio, so energy is conserved.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from sim_backend.mechanics.gears import Floats, Gears, GearTable, gear_table, turn_shafts
from sim_backend.mechanics.motor import GEAR_DAMPING_NM_S, GEAR_FRICTION_NM, ROTOR_INERTIA_KG_M2


@dataclass(frozen=True, slots=True)
class Coupling:
    """Coupling of one servo to one joint: position = sign * transmission * (shaft angle - angle at the zero).

    ``transmission`` is in rad per rad for a revolute joint and in meters per radian for a prismatic joint.
    ``zero_counts`` is the encoder count at the joint's zero, without homing offset.
    """

    servo_id: int
    joint: str
    sign: int = 1
    zero_counts: int = 2048
    transmission: float = 1.0
    counts_per_turn: int = 4096

    @property
    def zero_rad(self) -> float:
        """Shaft angle at the joint's zero, for the middle of the encoder count ``zero_counts``."""
        return (self.zero_counts + 0.5) * 2.0 * pi / self.counts_per_turn

    @property
    def ratio(self) -> float:
        """Signed joint displacement per radian of the shaft."""
        return self.sign * self.transmission


ShaftTable = NDArray[np.void]
"""An array with one ``SHAFT`` record for each shaft."""

SHAFT: Final = np.dtype(
    [
        # Indices of the shaft's joint in the arrays.
        ("position_at", "i8"),
        ("velocity_at", "i8"),
        ("effort_at", "i8"),
        # Shaft angle = joint position * per_unit + zero_rad; joint effort = torque * per_unit.
        ("per_unit", "f8"),
        ("zero_rad", "f8"),
    ]
)


@dataclass(frozen=True, slots=True)
class JointArrays:
    """Live arrays of the simulated joints. Reads return the current state, and efforts written to the arrays take
    effect."""

    position: Floats
    velocity: Floats
    effort: Floats
    position_at: Sequence[int]
    """Indices of the joints in ``position``. The next two fields contain the corresponding indices for velocity and
    effort."""
    velocity_at: Sequence[int]
    effort_at: Sequence[int]


class Plant(ABC):
    """Shafts in the order of ``couplings``, all advanced together by a fixed timestep.

    Compiled servo code uses ``joints`` and ``shafts``; other servos call the methods.
    """

    def __init__(
        self, couplings: Sequence[Coupling], timestep_s: float, joints: JointArrays, shafts: ShaftTable
    ) -> None:
        self.couplings = tuple(couplings)
        self.timestep_s = timestep_s
        self.joints = joints
        self.shafts = shafts
        self._rows: list[tuple[int, int, int, float, float]] = shafts.tolist()

    def angles(self) -> list[float]:
        """Return the shaft angles, in rad."""
        position = self.joints.position.tolist()
        return [position[at] * per_unit + zero_rad for at, _, _, per_unit, zero_rad in self._rows]

    def velocities(self) -> list[float]:
        """Return the shaft velocities, in rad/s."""
        velocity = self.joints.velocity.tolist()
        return [velocity[at] * per_unit for _, at, _, per_unit, _ in self._rows]

    def push(self, torques: Sequence[float]) -> None:
        """Apply the servos' torques (N m) in the next timestep."""
        effort = self.joints.effort
        for (_, _, at, per_unit, _), torque in zip(self._rows, torques, strict=True):
            effort[at] = torque * per_unit

    def slip(self, number: int, angle_rad: float) -> None:
        """Let a shaft slip: from now on, its angle is ``angle_rad`` larger at the same joint position."""
        self.shafts["zero_rad"][number] += angle_rad
        self._rows = self.shafts.tolist()

    @abstractmethod
    def fit(self, gears: Sequence[Gears | None]) -> None:
        """Apply the inertia and friction of these gears to the shafts. None leaves a shaft unchanged."""

    @abstractmethod
    def advance(self) -> None:
        """Advance by one timestep, applying the efforts in ``joints``."""


class JointWorld(Protocol):
    """The part of ``sim_backend.scene.world.World`` that a plant uses."""

    @property
    def joints(self) -> tuple[str, ...]: ...

    @property
    def timestep_s(self) -> float: ...

    @property
    def time_s(self) -> float: ...

    @property
    def arrays(self) -> JointArrays: ...

    def fit_gears(self, gears: Mapping[str, Gears]) -> None: ...

    def advance(self) -> None: ...


class WorldPlant(Plant):
    """Servos on a simulated arm. Joints without a servo swing freely.

    ``after_step(time_s)`` is called with the world's time after each step. Events around the arm are simulated in this
    call, so that they are the same in every run.
    """

    def __init__(
        self,
        world: JointWorld,
        couplings: Sequence[Coupling],
        after_step: Callable[[float], None] | None = None,
    ) -> None:
        unknown = [c.joint for c in couplings if c.joint not in world.joints]
        if unknown:
            raise ValueError(f"the world has no joint {', '.join(unknown)}; its joints are {world.joints}")
        arrays, places = world.arrays, [world.joints.index(c.joint) for c in couplings]
        rows = [
            (arrays.position_at[i], arrays.velocity_at[i], arrays.effort_at[i], 1.0 / c.ratio, c.zero_rad)
            for i, c in zip(places, couplings, strict=True)
        ]
        super().__init__(couplings, world.timestep_s, arrays, np.array(rows, SHAFT))
        self._world = world
        self._after_step = after_step

    def fit(self, gears: Sequence[Gears | None]) -> None:
        pairs = zip(self.couplings, gears, strict=True)
        self._world.fit_gears({c.joint: own.behind(1.0 / c.ratio) for c, own in pairs if own is not None})

    def advance(self) -> None:
        self._world.advance()
        if self._after_step is not None:
            self._after_step(self._world.time_s)


class BenchPlant(Plant):
    """Servos on a test bench, each with its own load: inertia, a constant torque, and friction. The bench has no
    joints.

    ``load_nm`` acts on a shaft all the time, as gravity does. Friction holds a shaft that is at rest. Servos with
    identified gears use those gears. All other servos use the values passed to the constructor.
    """

    def __init__(
        self,
        servo_ids: Sequence[int],
        *,
        timestep_s: float = 0.001,
        inertia_kg_m2: float = ROTOR_INERTIA_KG_M2,
        friction_nm: float = GEAR_FRICTION_NM,
        damping_nm_s: float = GEAR_DAMPING_NM_S,
    ) -> None:
        couplings = [Coupling(i, f"shaft{i}") for i in servo_ids]
        places = range(len(couplings))
        angles = np.array([c.zero_rad for c in couplings])
        joints = JointArrays(angles, np.zeros(len(places)), np.zeros(len(places)), places, places, places)
        # In this plant, the position of a joint is the angle of its shaft.
        super().__init__(couplings, timestep_s, joints, np.array([(i, i, i, 1.0, 0.0) for i in places], SHAFT))
        self.load_nm = np.zeros(len(couplings))
        usual = Gears(inertia_kg_m2, damping_nm_s, friction_nm, 0.0)
        self._gears: GearTable = gear_table([usual] * len(couplings))
        # This call loads the compiled code before the first timestep.
        turn_shafts(self._gears[:0], self.load_nm, joints.effort, joints.position, joints.velocity, timestep_s)

    def fit(self, gears: Sequence[Gears | None]) -> None:
        for i, own in enumerate(gears):
            if own is not None:
                self._gears[i] = gear_table([own])[0]

    def place(self, angles: Sequence[float]) -> None:
        """Turn the shafts to these angles (rad) and set their velocities to 0."""
        self.joints.position[:] = angles
        self.joints.velocity[:] = 0.0

    def advance(self) -> None:
        joints = self.joints
        turn_shafts(self._gears, self.load_nm, joints.effort, joints.position, joints.velocity, self.timestep_s)
