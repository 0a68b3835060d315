"""The motors of Dynamixel servos: identified where anybody has, else as the data sheet says.

BAM (github.com/Rhoban/bam) identified four on a pendulum, each with six laws of friction. Taken is its fourth, M4: the
simplest whose friction depends on the load as well as on the speed. M1 and M2 know no load; M3 knows no rest; M5 and M6
tell the two ends of the gears apart, by parameters of which several ended at nothing. Of a model's several fits: the
newest that ended within its bounds. ``python -m benchmarks.fidelity`` holds them against the data sheets.
"""

from typing import Final

from drivers.servos import x, xl320
from drivers.servos.ax_mx import Model as Protocol1Model
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.motor import MotorConstants
from sim_backend.servos.dynamixel.protocol1_models import MX_64, MX_106


def _identified(kt: float, ohm: float, gears: Gears) -> MotorConstants:
    """One magnet makes the torque and the back-EMF."""
    return MotorConstants(kt, kt, ohm, gears=gears)


# Gears: rotor, viscous, Coulomb, share of the load; sticking: Coulomb, share, speed, exponent.
IDENTIFIED: Final = {
    x.XL330_M288.name: _identified(
        0.3846, 3.063, Gears(0.001942, 0.004619, 0.01118, 0.1114, 0.0002863, 0.02838, 0.2377, 9.978)
    ),
    xl320.XL320.name: _identified(0.9949, 26.20, Gears(0.001482, 0.007794, 0.0, 0.2214, 0.02150, 0.0, 1.967, 1.836)),
    MX_64.name: _identified(1.663, 3.156, Gears(0.01096, 0.01475, 0.06155, 0.0, 0.02390, 0.2343, 1.521, 1.334)),
    MX_106.name: _identified(2.231, 2.372, Gears(0.02457, 0.05096, 0.0, 0.009150, 0.1049, 0.2224, 1.623, 1.323)),
}
"""By the model's name. The XL-320's is half as strong as its data sheet, which BAM's laws without load say too."""


def motor_of(model: x.Model | Protocol1Model) -> MotorConstants:
    """The motor of a Dynamixel servo; heat as in the STS3215 (assumed)."""
    return IDENTIFIED.get(model.name) or MotorConstants.of(model, model.stall_current_a)
