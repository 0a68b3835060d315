"""The power of a line of servos over time: another voltage, a plug that is pulled and put back.

Below ``BROWN_OUT_V`` a servo's controller stops: it is deaf, its motor free. When the voltage is back it starts as
after a reboot; what was not saved is gone. Known of STS servos, assumed of the others.
"""

from math import inf
from typing import Any, Final

from sim_backend.line.line import ServoLine
from sim_backend.servos.generic.packet_servo import WiredServo

BROWN_OUT_V: Final = 3.5
"""What a regulator of 3.3 V needs to feed the controller (assumed)."""


def feed(line: ServoLine[Any], voltage_v: float | None = None, resistance_ohm: float | None = None) -> None:
    """Feed all servos of the line with so much, over such leads, from now on; None: as the line was built.

    No voltage at all is a pulled plug.
    """
    line.rig.feed(voltage_v, resistance_ohm)
    for servo in line.servos:
        _supplied(servo, line.rig.supply_of(servo).voltage_v)


def watch_supply(line: ServoLine[Any]) -> None:
    """Let servos stop whose supply has broken down under its load, and those start to which it has come back."""
    for servo in line.servos:
        _supplied(servo, servo.firmware.voltage_v)


def restart(servo: WiredServo) -> None:
    """The servo starts anew, as power comes back to it: after a bad plug's moment, for instance."""
    servo.power_cycle()
    servo.deaf_s = servo.BOOT_S


def _supplied(servo: WiredServo, voltage_v: float) -> None:
    dark = servo.deaf_s == inf
    if voltage_v < BROWN_OUT_V and not dark:
        servo.power_cycle()
        servo.deaf_s = inf
    elif voltage_v >= BROWN_OUT_V and dark:
        restart(servo)
