"""Power supply of a servo bus: changes in the supply voltage, and plugs that are disconnected and connected.

Below ``BROWN_OUT_V``, a servo's controller stops, so the servo does not receive anything and its torque is off. When
the voltage recovers, the servo starts as after a reboot, and values that were not saved are lost. This behavior is
known for
STS servos and assumed for other servos.
"""

from math import inf
from typing import Any, Final

from sim_backend.line.line import ServoLine
from sim_backend.servos.generic.packet_servo import WiredServo

BROWN_OUT_V: Final = 3.5
"""Minimum voltage at which a 3.3 V regulator can feed the controller (assumed)."""


def feed(line: ServoLine[Any], voltage_v: float | None = None, resistance_ohm: float | None = None) -> None:
    """From now on, power all servos on the bus with this voltage, over leads with this resistance.

    None restores the original value of the bus. A voltage of 0 simulates a disconnected plug.
    """
    line.rig.feed(voltage_v, resistance_ohm)
    for servo in line.servos:
        _supplied(servo, line.rig.supply_of(servo).voltage_v)


def watch_supply(line: ServoLine[Any]) -> None:
    """Stop the servos whose voltage is too low under load, and start those whose voltage has recovered."""
    for servo in line.servos:
        _supplied(servo, servo.firmware.voltage_v)


def restart(servo: WiredServo, boot_s: float | None = None) -> None:
    """Restart the servo as after a short loss of power, for example caused by a loose plug.

    Args:
        servo: The servo.
        boot_s: Time until the servo responds again, in seconds; None for the usual time of its series.
    """
    servo.power_cycle()
    servo.deaf_s = servo.BOOT_S if boot_s is None else boot_s


def _supplied(servo: WiredServo, voltage_v: float) -> None:
    dark = servo.deaf_s == inf
    if voltage_v < BROWN_OUT_V and not dark:
        servo.power_cycle()
        servo.deaf_s = inf
    elif voltage_v >= BROWN_OUT_V and dark:
        restart(servo)
