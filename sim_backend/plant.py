"""What the servos' shafts are fastened to: the simulated arm, or a test bench. SI units.

A servo knows only its shaft. A ``Coupling`` says which joint the shaft moves and how; forces go
back by the same ratio, so no energy appears or is lost on the way.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import copysign, pi
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim_backend.motor import GEAR_DAMPING_NM_S, GEAR_FRICTION_NM, ROTOR_INERTIA_KG_M2


@dataclass(frozen=True, slots=True)
class Coupling:
    """One servo on one joint: position = sign * transmission * (shaft angle - angle at the zero).

    ``transmission`` is rad per rad for a revolute joint, metres per radian for a prismatic one.
    ``zero_counts`` is what the encoder says, without homing offset, where the joint is at zero.
    """

    servo_id: int
    joint: str
    sign: int = 1
    zero_counts: int = 2048
    transmission: float = 1.0
    counts_per_turn: int = 4096

    @property
    def zero_rad(self) -> float:
        """The shaft's angle where the joint is at zero: mid-count, not at the count's edge."""
        return (self.zero_counts + 0.5) * 2.0 * pi / self.counts_per_turn

    @property
    def ratio(self) -> float:
        """Joint units per radian of the shaft, with the sign."""
        return self.sign * self.transmission


class Plant(Protocol):
    """Shafts in the order of ``couplings``, all advanced together by a fixed step."""

    @property
    def couplings(self) -> tuple[Coupling, ...]: ...

    @property
    def timestep_s(self) -> float: ...

    def angles(self) -> list[float]:
        """The shafts' angles, rad."""
        ...

    def velocities(self) -> list[float]:
        """The shafts' velocities, rad/s."""
        ...

    def step(self, torques: Sequence[float]) -> None:
        """Advance one timestep under the servos' torques, N m."""
        ...


class JointWorld(Protocol):
    """What a plant needs of ``sim_backend.world.World``."""

    @property
    def joints(self) -> tuple[str, ...]: ...

    @property
    def timestep_s(self) -> float: ...

    @property
    def time_s(self) -> float: ...

    def position(self) -> NDArray[np.float64]: ...

    def velocity(self) -> NDArray[np.float64]: ...

    def step(self, effort: Sequence[float]) -> None: ...


class WorldPlant:
    """The servos on a simulated arm. Joints without a servo swing freely.

    ``after_step(time_s)`` is called after every step with the world's time: for what happens in the
    world beside the arm, in world time, so that it is the same in every run.
    """

    def __init__(
        self,
        world: JointWorld,
        couplings: Sequence[Coupling],
        after_step: Callable[[float], None] | None = None,
    ) -> None:
        unknown = [c.joint for c in couplings if c.joint not in world.joints]
        if unknown:
            raise ValueError(f"the world has no joint {', '.join(unknown)}; it has {world.joints}")
        self.couplings = tuple(couplings)
        self.timestep_s = world.timestep_s
        self._world = world
        self._after_step = after_step
        self._effort = [0.0] * len(world.joints)
        places = {joint: i for i, joint in enumerate(world.joints)}
        self._map = [(places[c.joint], 1.0 / c.ratio, c.zero_rad) for c in self.couplings]

    def angles(self) -> list[float]:
        position = self._world.position().tolist()
        return [position[i] * per_unit + zero for i, per_unit, zero in self._map]

    def velocities(self) -> list[float]:
        velocity = self._world.velocity().tolist()
        return [velocity[i] * per_unit for i, per_unit, _ in self._map]

    def step(self, torques: Sequence[float]) -> None:
        effort = self._effort
        for (i, per_unit, _), torque in zip(self._map, torques, strict=True):
            effort[i] = torque * per_unit
        self._world.step(effort)
        if self._after_step is not None:
            self._after_step(self._world.time_s)


class BenchPlant:
    """Servos on a bench, each with its own load: inertia, a constant torque, friction of both kinds. No joints.

    ``load_nm`` pulls on a shaft all the time, as gravity does; friction holds a shaft that stands.
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
        self.couplings = tuple(Coupling(i, f"shaft{i}") for i in servo_ids)
        self.timestep_s = timestep_s
        self.load_nm = [0.0] * len(servo_ids)
        self._angles = [c.zero_rad for c in self.couplings]
        self._velocities = [0.0] * len(servo_ids)
        self._inertia = inertia_kg_m2
        self._friction = friction_nm
        self._damping = damping_nm_s

    def place(self, angles: Sequence[float]) -> None:
        """Turn the shafts to these angles (rad), at rest."""
        self._angles = list(angles)
        self._velocities = [0.0] * len(self._angles)

    def angles(self) -> list[float]:
        return list(self._angles)

    def velocities(self) -> list[float]:
        return list(self._velocities)

    def step(self, torques: Sequence[float]) -> None:
        per_nm = self.timestep_s / self._inertia
        friction = self._friction * per_nm
        for i, torque in enumerate(torques):
            velocity = self._velocities[i]
            velocity += (torque + self.load_nm[i] - self._damping * velocity) * per_nm
            # Friction takes speed away but never turns it round.
            velocity = copysign(max(0.0, abs(velocity) - friction), velocity)
            self._velocities[i] = velocity
            self._angles[i] += velocity * self.timestep_s
