"""The power of a line of STS servos over time: another voltage, a plug that is pulled and put back.

Below ``BROWN_OUT_V`` a servo's controller stops: it is deaf, its motor free. When the voltage is back it starts as
after a reboot; what was not saved is gone.
"""

from math import inf
from typing import Any, Final

from sim_backend.line import ServoLine
from sim_backend.servo import REBOOT_S, VirtualServo

BROWN_OUT_V: Final = 3.5
"""What a regulator of 3.3 V needs to feed the controller (assumed)."""


def feed(line: ServoLine[Any], voltage_v: float) -> None:
    """Feed all servos of the line with so much from now on; none at all is a pulled plug."""
    line.rig.feed(voltage_v)
    for servo in line.servos:
        if not isinstance(servo, VirtualServo):
            raise TypeError(
                f"servo {servo.servo_id} is no STS: what a {servo.model.name} does without power is unknown"
            )
        if voltage_v < BROWN_OUT_V:
            servo.power_cycle()
            servo.firmware.deaf_s = inf
        elif servo.firmware.deaf_s == inf:
            restart(servo)


def restart(servo: VirtualServo) -> None:
    """The servo starts anew, as power comes back to it: after a bad plug's moment, for instance."""
    servo.power_cycle()
    servo.firmware.deaf_s = REBOOT_S
