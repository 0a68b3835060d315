"""Gears between a motor and its shaft, with inertia and with friction that depends on load and speed.

The friction law is BAM's fourth law (github.com/Rhoban/bam, M4). The friction on a shaft consists of Coulomb friction,
a fraction of the torque through the gears, and viscous friction. Near rest, the first two parts are larger (Stribeck
effect).
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
"""An array with one ``GEARS`` record for each shaft."""
Record = Any
"""One ``GEARS`` record. The type is Any, because numba cannot name the type of a record."""


@dataclass(frozen=True, slots=True)
class Gears:
    """Gears of one servo, as seen at the output shaft. SI units."""

    rotor_kg_m2: float
    """Inertia of the motor and all wheels."""
    viscous_nm_s: float
    coulomb_nm: float
    load_share: float
    """Friction per N m of torque through the gears."""
    sticking_nm: float = 0.0
    """Additional Coulomb friction when a shaft is at rest."""
    sticking_share: float = 0.0
    """Additional ``load_share`` when a shaft is at rest."""
    sticking_rad_s: float = 1.0
    """Speed at which the additional friction is reduced to 1/e of its value at rest."""
    sticking_exponent: float = 1.0

    def friction_nm(self, load_nm: float, speed_rad_s: float) -> float:
        """Return the maximum friction torque, excluding viscous friction.

        ``load_nm`` is the torque through the gears: the motor torque minus the load torque. If a shaft is
        driven at one end and held at the other, both torques act on the teeth.
        """
        largest_nm: float = friction_nm(gear_table([self])[0], load_nm, speed_rad_s)
        return largest_nm

    def behind(self, ratio: float) -> "Gears":
        """Convert the gears to joint units, for a joint whose shaft turns ``ratio`` radians per joint unit."""
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
    """Return the gears as an array for compiled code."""
    return np.array([astuple(own) for own in gears], GEARS)


@compiled
def friction_nm(gears: Record, load_nm: float, speed_rad_s: float) -> float:
    """Compute ``Gears.friction_nm`` for one record."""
    sticking = exp(-((abs(speed_rad_s) / gears.sticking_rad_s) ** gears.sticking_exponent))
    share = gears.load_share + sticking * gears.sticking_share
    largest_nm: float = gears.coulomb_nm + sticking * gears.sticking_nm + share * abs(load_nm)
    return largest_nm


@compiled
def renew_friction(gears: GearTable, load_nm: Floats, speed_rad_s: Floats, least_nm: float, friction: Floats) -> None:
    """Write the maximum friction of all shafts to ``friction`` (n,)."""
    for i in range(len(gears)):
        friction[i] = max(least_nm, friction_nm(gears[i], load_nm[i], speed_rad_s[i]))


@compiled
def turn_shafts(
    gears: GearTable, load_nm: Floats, torque_nm: Floats, position: Floats, velocity: Floats, step_s: float
) -> None:
    """Advance shafts (n,) by one timestep under their motor and load torques."""
    for i in range(len(gears)):
        per_nm = step_s / gears[i].rotor_kg_m2
        friction = friction_nm(gears[i], torque_nm[i] - load_nm[i], velocity[i]) * per_nm
        speed = velocity[i] + (torque_nm[i] + load_nm[i] - gears[i].viscous_nm_s * velocity[i]) * per_nm
        # Friction slows a shaft down but never reverses it.
        speed = copysign(max(0.0, abs(speed) - friction), speed)
        velocity[i] = speed
        position[i] += speed * step_s
