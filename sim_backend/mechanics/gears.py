"""Gears between a motor and its shaft: inertia, and friction that grows with the load and shrinks with the speed.

The law is BAM's fourth (github.com/Rhoban/bam, M4): a shaft is held back by at most a Coulomb friction, a share of the
torque that goes through the gears, and a viscous friction. Near rest both of the first are larger (Stribeck).
"""

from collections.abc import Iterable
from dataclasses import astuple, dataclass, replace
from math import copysign, exp
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_backend.compiled import compiled

Floats = NDArray[np.float64]
GearTable = NDArray[np.void]
"""An array with one record of ``GEARS`` for each shaft."""
Record = Any
"""One record of ``GEARS``: numba has no name for its type."""


@dataclass(frozen=True, slots=True)
class Gears:
    """One servo's gears, seen at the output shaft. SI units."""

    rotor_kg_m2: float
    """Of the motor and all wheels."""
    viscous_nm_s: float
    coulomb_nm: float
    load_share: float
    """Friction in a newton metre of the torque through the gears."""
    sticking_nm: float = 0.0
    """Coulomb friction beyond ``coulomb_nm``, of a shaft at rest."""
    sticking_share: float = 0.0
    """The same of ``load_share``."""
    sticking_rad_s: float = 1.0
    """The speed at which a share of 1/e of the sticking is left."""
    sticking_exponent: float = 1.0

    def friction_nm(self, load_nm: float, speed_rad_s: float) -> float:
        """The largest torque of friction, without the viscous one.

        ``load_nm`` goes through the gears: what the motor gives less what the rest of the world gives, as a shaft
        that is pulled at one end and held at the other has both on its teeth.
        """
        largest_nm: float = friction_nm(gear_table([self])[0], load_nm, speed_rad_s)
        return largest_nm

    def behind(self, ratio: float) -> "Gears":
        """The same as felt by a joint whose shaft turns ``ratio`` radians in a unit of the joint."""
        ratio = abs(ratio)
        return replace(
            self,
            rotor_kg_m2=self.rotor_kg_m2 * ratio * ratio,
            viscous_nm_s=self.viscous_nm_s * ratio * ratio,
            coulomb_nm=self.coulomb_nm * ratio,
            sticking_nm=self.sticking_nm * ratio,
            sticking_rad_s=self.sticking_rad_s / ratio,
        )


GEARS: Final = np.dtype([(name, "f8") for name in Gears.__dataclass_fields__])


def gear_table(gears: Iterable[Gears]) -> GearTable:
    """The same gears for compiled code."""
    return np.array([astuple(own) for own in gears], GEARS)


@compiled
def friction_nm(gears: Record, load_nm: float, speed_rad_s: float) -> float:
    """What ``Gears.friction_nm`` returns."""
    sticking = exp(-((abs(speed_rad_s) / gears.sticking_rad_s) ** gears.sticking_exponent))
    share = gears.load_share + sticking * gears.sticking_share
    largest_nm: float = gears.coulomb_nm + sticking * gears.sticking_nm + share * abs(load_nm)
    return largest_nm


@compiled
def renew_friction(gears: GearTable, load_nm: Floats, speed_rad_s: Floats, least_nm: float, friction: Floats) -> None:
    """Write the largest friction of all shafts into ``friction`` (n,)."""
    for i in range(len(gears)):
        friction[i] = max(least_nm, friction_nm(gears[i], load_nm[i], speed_rad_s[i]))


@compiled
def turn_shafts(
    gears: GearTable, load_nm: Floats, torque_nm: Floats, position: Floats, velocity: Floats, step_s: float
) -> None:
    """Advance shafts (n,) by one timestep under the torques of their motors and loads."""
    for i in range(len(gears)):
        per_nm = step_s / gears[i].rotor_kg_m2
        friction = friction_nm(gears[i], torque_nm[i] - load_nm[i], velocity[i]) * per_nm
        speed = velocity[i] + (torque_nm[i] + load_nm[i] - gears[i].viscous_nm_s * velocity[i]) * per_nm
        # Friction takes speed away but never turns it round.
        speed = copysign(max(0.0, abs(speed) - friction), speed)
        velocity[i] = speed
        position[i] += speed * step_s
