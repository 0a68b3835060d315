"""The brushed motor behind the gears, seen at the output shaft: torque, current, heat. SI units.

From the datasheet (STS3215-C018, 12 V): stall torque, no-load speed, stall current 2.7 A.
From a published bench test (+15 K in ten minutes at 1.5 kg on a 10 cm arm, half the stall torque):
thermal resistance and time constant, roughly. Gear friction and the rotor's inertia are the
plant's, because a physics engine handles them better than a torque can; ``ROTOR_INERTIA_KG_M2`` is
what the plant should have at least, or the back-EMF is too stiff for steps of a millisecond.
"""

from dataclasses import dataclass
from typing import Final

from drivers.servos.register import ServoModel

ROTOR_INERTIA_KG_M2: Final = 0.012
"""Of the rotor, at the output shaft: 1:345 squared times an assumed 1e-7 kg m2 of rotor."""


@dataclass(frozen=True, slots=True)
class MotorConstants:
    """What one motor with its gears does. Ambient temperature included, because it sits there."""

    stall_torque_nm: float
    no_load_speed_rad_s: float
    rated_voltage_v: float
    stall_current_a: float = 2.7
    thermal_resistance_k_w: float = 2.5
    thermal_time_s: float = 400.0
    ambient_c: float = 27.0

    @classmethod
    def of(cls, model: ServoModel) -> "MotorConstants":
        """The constants of a servo model at its rated voltage."""
        return cls(model.stall_torque_nm, model.no_load_speed_rad_s, model.rated_voltage_v)

    @property
    def resistance_ohm(self) -> float:
        """Of the winding: all that limits the current at stall."""
        return self.rated_voltage_v / self.stall_current_a


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
