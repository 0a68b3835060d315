"""Motors of Dynamixel servos: identified on hardware if available, otherwise derived from the data sheet.

BAM (github.com/Rhoban/bam) identified four motors on a pendulum, each with six friction laws. This module uses the
fourth law, M4, which is the simplest law whose friction depends on both load and speed. M1 and M2 ignore the load, and
M3 does not model friction at rest separately. M5 and M6 distinguish between the two ends of the gears, but several of
their parameters were fitted to zero. If a model has several fits, the latest fit within its bounds is used. ``python -m
benchmarks.fidelity`` compares the motors with the data sheets.
"""

from typing import Final

from drivers.servos import x, xl320
from drivers.servos.ax_mx import MX_64, MX_106, AxMxModel
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.motor import MotorConstants


def _identified(kt: float, ohm: float, gears: Gears) -> MotorConstants:
    """Return a motor whose torque constant is also its back-EMF constant, because one magnet determines both."""
    return MotorConstants(kt, kt, ohm, gears=gears)


# The gear values are in the order rotor, viscous, Coulomb, load share; then for static friction: Coulomb, load share,
# speed, exponent.
IDENTIFIED: Final = {
    x.XL330_M288.name: _identified(
        0.3846, 3.063, Gears(0.001942, 0.004619, 0.01118, 0.1114, 0.0002863, 0.02838, 0.2377, 9.978)
    ),
    xl320.XL320.name: _identified(0.9949, 26.20, Gears(0.001482, 0.007794, 0.0, 0.2214, 0.02150, 0.0, 1.967, 1.836)),
    MX_64.name: _identified(1.663, 3.156, Gears(0.01096, 0.01475, 0.06155, 0.0, 0.02390, 0.2343, 1.521, 1.334)),
    MX_106.name: _identified(2.231, 2.372, Gears(0.02457, 0.05096, 0.0, 0.009150, 0.1049, 0.2224, 1.623, 1.323)),
}
"""Identified motors, keyed by model name.

The identified XL-320 motor is half as strong as its data sheet states. BAM's friction laws that ignore the load lead to
the same result.
"""


def motor_of(model: x.XModel | AxMxModel) -> MotorConstants:
    """Return the motor of a Dynamixel servo. The thermal constants are those of the STS3215 (assumed).

    A motor that is not in ``IDENTIFIED`` has the torque, speed and current of its data sheet.
    """
    return IDENTIFIED.get(model.name) or MotorConstants.of(model, model.stall_current_a)
