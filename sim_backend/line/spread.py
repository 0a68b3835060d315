"""Differences between arms that are built from the same parts. Friction, motors, masses and supply deviate from their
nominal values."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final

import numpy as np

from sim_backend.line.rig import Supply
from sim_backend.mechanics.motor import MotorConstants

SHARE: Final = 0.1
"""Maximum deviation of a value, as a fraction of the value. All deviations up to this maximum are equally likely."""


class Quantity(IntEnum):
    """Quantities that deviate.

    Each quantity has its own random numbers, so that an additional draw for one quantity does not change the others.
    """

    MAGNET = 1
    RESISTANCE = 2
    FRICTION = 3
    MASS = 4
    SUPPLY = 5


@dataclass(frozen=True, slots=True)
class Spread:
    """Deviations of one arm, which depend only on ``seed``. A seed of None means the nominal arm."""

    seed: int | None = None

    def factor(self, quantity: Quantity, which: int) -> float:
        """Return the factor by which the nominal value of a quantity is multiplied, for one servo, joint or body."""
        if self.seed is None:
            return 1.0
        return 1.0 + SHARE * np.random.default_rng((self.seed, quantity, which)).uniform(-1.0, 1.0)

    def motor(self, nominal: MotorConstants, servo_id: int) -> MotorConstants:
        """Return the motor of one servo. One magnet determines both the torque and the back-EMF."""
        magnet = self.factor(Quantity.MAGNET, servo_id)
        return replace(
            nominal,
            torque_constant_nm_a=nominal.torque_constant_nm_a * magnet,
            back_emf_v_s=nominal.back_emf_v_s * magnet,
            resistance_ohm=nominal.resistance_ohm * self.factor(Quantity.RESISTANCE, servo_id),
        )

    def supply(self, nominal: Supply) -> Supply:
        """Return the power supply of a bus."""
        return replace(nominal, voltage_v=nominal.voltage_v * self.factor(Quantity.SUPPLY, 0))

    def vary(self, model: Any) -> None:
        """Vary the joint friction and the body masses in a MuJoCo model. Shapes are not changed."""
        for dof in range(model.nv):
            friction = self.factor(Quantity.FRICTION, dof)
            model.dof_frictionloss[dof] *= friction
            model.dof_damping[dof] *= friction
        for body in range(model.nbody):
            mass = self.factor(Quantity.MASS, body)
            model.body_mass[body] *= mass
            model.body_inertia[body] *= mass


NOMINAL: Final = Spread()
