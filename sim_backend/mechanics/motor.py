"""The brushed motor behind the gears, seen at the output shaft: torque, current, heat. SI units.

Gear friction and the rotor's inertia are the plant's, because a physics engine handles them better than a torque
can. docs/simulation.md says where each number comes from.
"""

from dataclasses import dataclass, replace
from typing import Final

from drivers.servos import sts
from drivers.servos.register import ServoModel
from sim_backend.mechanics.gears import Gears

ROTOR_INERTIA_KG_M2: Final = 0.0154
"""Of an STS3215's rotor and gears at the output shaft: 3.25 N m of full drive (BAM's kt and resistance) start the shaft
at 211 rad/s2 (the reimplemented firmware's step responses, recorded on hardware without load)."""
GEAR_FRICTION_NM: Final = 0.052
"""Coulomb friction of an STS3215's gears, identified by BAM on a pendulum."""
GEAR_DAMPING_NM_S: Final = 0.03
"""Viscous friction that leaves 45 rpm of the 12 V motor's full drive, as its data sheet says."""
IDENTIFIED_DAMPING_NM_S: Final = 0.052
"""What BAM identified with the 7.4 V motor."""
STALL_CURRENT_A: Final = 2.7
"""Of the STS3215 at 12 V; of other Feetech servos for want of their own."""


@dataclass(frozen=True, slots=True)
class MotorConstants:
    """What one motor with its gears does. Ambient temperature included, because it sits there.

    Heat: +15 K in ten minutes at half the stall torque, in a published test of an STS3215; one heat capacity.
    """

    torque_constant_nm_a: float
    back_emf_v_s: float
    resistance_ohm: float
    thermal_resistance_k_w: float = 2.5
    thermal_time_s: float = 400.0
    ambient_c: float = 27.0
    gears: Gears | None = None
    """Where anybody has identified them; the plant's own otherwise."""

    @classmethod
    def of(cls, model: ServoModel, stall_current_a: float = STALL_CURRENT_A) -> "MotorConstants":
        """What a data sheet says: torque and current at stall, speed without load, all at the rated voltage."""
        voltage_v = model.rated_voltage_v
        return cls(
            model.stall_torque_nm / stall_current_a,
            voltage_v / model.no_load_speed_rad_s,
            voltage_v / stall_current_a,
        )


# Data sheet's torque and current at stall; back-EMF such that full drive, friction taken off, turns at its 45 rpm.
STS3215_12V: Final = MotorConstants(2.94 / 2.7, 2.3, 12.0 / 2.7)
# BAM's, identified on hardware; with ROTOR_INERTIA_KG_M2 and 0.052 N m s of damping they have the time constant of
# 26 ms and the 5.4 rad/s without load of the recorded step responses.
STS3215_7V4: Final = MotorConstants(1.21, 1.21, 2.68)


def _geared(ratio: float) -> MotorConstants:
    """The 7.4 V motor behind ``ratio`` times the gears that were identified; the rotor is felt by the square of it."""
    gears = Gears(ROTOR_INERTIA_KG_M2 * ratio**2, IDENTIFIED_DAMPING_NM_S * ratio**2, GEAR_FRICTION_NM * ratio, 0.0)
    at_shaft = STS3215_7V4.torque_constant_nm_a * ratio
    return replace(STS3215_7V4, torque_constant_nm_a=at_shaft, back_emf_v_s=at_shaft, gears=gears)


_IDENTIFIED: Final = {
    sts.STS3215: STS3215_12V,
    sts.STS3215_C001: STS3215_7V4,
    sts.STS3215_C044: _geared(191 / 345),
    sts.STS3215_C046: _geared(147 / 345),
}


def sts_motor(model: ServoModel) -> MotorConstants:
    """The motor of an STS servo: identified where anybody has, else as its data sheet says."""
    return _IDENTIFIED.get(model) or MotorConstants.of(model)


class Thermometer:
    """The motor's temperature: one heat capacity, one way out to the air."""

    def __init__(self, motor: MotorConstants) -> None:
        self._motor = motor
        self.temperature_c = motor.ambient_c

    def step(self, dt_s: float, current_a: float) -> None:
        """Heat by the winding's loss, cool towards the air."""
        motor = self._motor
        power_w = current_a * current_a * motor.resistance_ohm
        steady_c = motor.ambient_c + power_w * motor.thermal_resistance_k_w
        self.temperature_c += (steady_c - self.temperature_c) * dt_s / motor.thermal_time_s
