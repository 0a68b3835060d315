"""Gears between a motor and its shaft: inertia, and friction that grows with the load and shrinks with the speed.

The law is BAM's fourth (github.com/Rhoban/bam, M4): a shaft is held back by at most a Coulomb friction, a share of the
torque that goes through the gears, and a viscous friction. Near rest both of the first are larger (Stribeck).
"""

from dataclasses import dataclass, replace
from math import exp


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
        sticking = exp(-((abs(speed_rad_s) / self.sticking_rad_s) ** self.sticking_exponent))
        share = self.load_share + sticking * self.sticking_share
        return self.coulomb_nm + sticking * self.sticking_nm + share * abs(load_nm)

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
