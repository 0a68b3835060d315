"""Brushed motor with gears, as seen at the output shaft: torque, current and temperature in SI units.

Gear friction and rotor inertia are part of the plant, because a physics engine simulates them better than an additional
torque would. docs/simulation.md lists the source of each value.
"""

from dataclasses import dataclass, replace
from typing import Final

from drivers.servos import sts
from drivers.servos.register import ServoModel
from sim_backend.mechanics.gears import Gears

ROTOR_INERTIA_KG_M2: Final = 0.0154
"""Inertia of an STS3215's rotor and gears at the output shaft.

The value was derived from no-load step responses, which were recorded with the reimplemented firmware. The responses
start with 211 rad/s2 at the full-drive torque of 3.25 N m, which is computed from the kt and the resistance identified
by BAM.
"""
GEAR_FRICTION_NM: Final = 0.052
"""Coulomb friction of an STS3215's gears, identified by BAM on a pendulum."""
GEAR_DAMPING_NM_S: Final = 0.03
"""Viscous friction at which the 12 V motor reaches 45 rpm at full drive, as stated in its data sheet."""
IDENTIFIED_DAMPING_NM_S: Final = 0.052
"""Viscous friction that BAM identified for the 7.4 V motor."""
STALL_CURRENT_A: Final = 2.7
"""Stall current of the STS3215 at 12 V, also used for Feetech servos without a published value."""


@dataclass(frozen=True, slots=True)
class MotorConstants:
    """Constants of one motor with its gears, including the ambient temperature.

    The thermal model consists of one heat capacity. A published test of an STS3215 at half its stall torque showed a
    temperature rise of 15 K in ten minutes.
    """

    torque_constant_nm_a: float
    back_emf_v_s: float
    resistance_ohm: float
    thermal_resistance_k_w: float = 2.5
    thermal_time_s: float = 400.0
    ambient_c: float = 27.0
    gears: Gears | None = None
    """Identified gears; None to keep the friction and the rotor inertia of the plant."""

    @classmethod
    def of(cls, model: ServoModel, stall_current_a: float = STALL_CURRENT_A) -> "MotorConstants":
        """Return motor constants computed from a data sheet, which specifies the stall torque, the stall current and
        the no-load speed."""
        voltage_v = model.rated_voltage_v
        return cls(
            model.stall_torque_nm / stall_current_a,
            voltage_v / model.no_load_speed_rad_s,
            voltage_v / stall_current_a,
        )


# The stall torque and the stall current are from the data sheet. With this back-EMF, the motor reaches the data sheet's
# 45 rpm at full drive, including friction.
STS3215_12V: Final = MotorConstants(2.94 / 2.7, 2.3, 12.0 / 2.7)
# Identified on hardware by BAM. Together with ROTOR_INERTIA_KG_M2 and a damping of 0.052 N m s, these values reproduce
# the recorded step responses: a time constant of 26 ms and a no-load speed of 5.4 rad/s.
STS3215_7V4: Final = MotorConstants(1.21, 1.21, 2.68)


def _geared(ratio: float) -> MotorConstants:
    """Return the 7.4 V motor with a gear ratio of ``ratio`` times the identified gear ratio.

    The inertia of the rotor is proportional to the square of the ratio.
    """
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
    """Return the motor of an STS servo: the identified motor if available, otherwise a motor from the data sheet."""
    return _IDENTIFIED.get(model) or MotorConstants.of(model)


class Thermometer:
    """Motor temperature, modeled with one heat capacity and one heat path to the air."""

    def __init__(self, motor: MotorConstants) -> None:
        self._motor = motor
        self.temperature_c = motor.ambient_c

    def step(self, dt_s: float, current_a: float) -> None:
        """Heat the motor with the winding losses, and cool it toward the air temperature."""
        motor = self._motor
        power_w = current_a * current_a * motor.resistance_ohm
        steady_c = motor.ambient_c + power_w * motor.thermal_resistance_k_w
        self.temperature_c += (steady_c - self.temperature_c) * dt_s / motor.thermal_time_s
