"""Restart Dynamixel servos that have counted whole turns, before their torque is enabled.

A limp servo in position mode keeps counting turns when it is turned by hand, and discards the whole turns when its
torque is enabled (e-manual, "Present Position"). A restart also discards the turns, but does so while the servo is
limp, so that the position can be measured before torque is enabled.
"""

import logging
from contextlib import suppress
from functools import partial
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.driver_errors import ServoCorrupt, ServoSilent
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from hal.joint import Joint

LOG = logging.getLogger("servoloop.hal")

RESTART_S: Final = 0.5
"""Delay between a restart and the next request to the servo, in seconds."""


def has_turned(joint: Joint, counts: int, bus: Bus) -> bool:
    """Return whether a servo reports whole turns that it will discard when its torque is enabled.

    Args:
        joint: The joint.
        counts: Position reported by the joint's servo, in counts. The bus has already removed the whole turns of limp
            servos in extended position mode.
        bus: Bus of the servo.

    Returns:
        Whether the servo is a Dynamixel X that has counted whole turns.
    """
    if series_of(joint.model) is not X or not joint.turns(counts):
        return False
    offset = retry(partial(bus.read, joint.servo_id, x.homing_offset))
    return x.within_turn(counts, offset) != counts


def restart(joint: Joint, clock: Clock, bus: Bus) -> None:
    """Restart a limp servo, wait until it responds, and identify it again.

    Args:
        joint: The joint.
        clock: Clock of the control loop.
        bus: Bus of the servo.

    Raises:
        ServoError: The servo does not respond again.
    """
    LOG.info("%s (servo %d) has counted whole turns while it was limp: restarting it", joint.name, joint.servo_id)
    with suppress(ServoSilent, ServoCorrupt):  # the acknowledgment may be lost
        bus.reboot(joint.servo_id)
    clock.sleep_until(clock.now() + RESTART_S)
    retry(partial(bus.ping, joint.servo_id))
    bus.identify(joint.servo_id, joint.model)
