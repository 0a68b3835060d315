"""Two arms of the same parts are never the same: friction, motors, masses and supply lie about their nominal values."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final

import numpy as np

from sim_backend.line.rig import Supply
from sim_backend.mechanics.motor import MotorConstants

SHARE: Final = 0.1
"""The largest deviation of a value, as a share of it; all within are equally likely."""


class Quantity(IntEnum):
    """What differs. Each has random numbers of its own: one more of them leaves the others as they are."""

    MAGNET = 1
    RESISTANCE = 2
    FRICTION = 3
    MASS = 4
    SUPPLY = 5


@dataclass(frozen=True, slots=True)
class Spread:
    """One arm of many, the same for the same ``seed``. None: the nominal one."""

    seed: int | None = None

    def factor(self, quantity: Quantity, which: int) -> float:
        """By what the quantity of one servo, joint or body differs from its nominal value."""
        if self.seed is None:
            return 1.0
        return 1.0 + SHARE * np.random.default_rng((self.seed, quantity, which)).uniform(-1.0, 1.0)

    def motor(self, nominal: MotorConstants, servo_id: int) -> MotorConstants:
        """One servo's motor. One magnet makes both the torque and the back-EMF."""
        magnet = self.factor(Quantity.MAGNET, servo_id)
        return replace(
            nominal,
            torque_constant_nm_a=nominal.torque_constant_nm_a * magnet,
            back_emf_v_s=nominal.back_emf_v_s * magnet,
            resistance_ohm=nominal.resistance_ohm * self.factor(Quantity.RESISTANCE, servo_id),
        )

    def supply(self, nominal: Supply) -> Supply:
        """The power supply of a line."""
        return replace(nominal, voltage_v=nominal.voltage_v * self.factor(Quantity.SUPPLY, 0))

    def vary(self, model: Any) -> None:
        """The friction of each joint and the mass of each body of a MuJoCo model, bodies' shapes as they are."""
        for dof in range(model.nv):
            friction = self.factor(Quantity.FRICTION, dof)
            model.dof_frictionloss[dof] *= friction
            model.dof_damping[dof] *= friction
        for body in range(model.nbody):
            mass = self.factor(Quantity.MASS, body)
            model.body_mass[body] *= mass
            model.body_inertia[body] *= mass


NOMINAL: Final = Spread()
