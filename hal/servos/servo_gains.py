"""Write the gains that servos keep in RAM when torque is enabled, because another program may have changed them.

Gains in RAM are kept until the servo loses power. Activation therefore writes the gains specified in the robot file,
and factory values for all other gains.
"""

import logging
from collections.abc import Mapping
from functools import partial

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.servos.catalog import series_of
from drivers.servos.ram_gains import ram_gains
from drivers.servos.register import Register
from hal.joint import Joint

LOG = logging.getLogger("servoloop.hal")


def wanted_gains(joint: Joint) -> dict[Register, int]:
    """Return the gains that the control stack uses for a joint and that its servo keeps in RAM.

    Args:
        joint: The joint with the gains from the robot file.

    Returns:
        Gain values, keyed by register; empty if the servo's gains are in EEPROM.
    """
    gains = dict(ram_gains(joint.model))
    named = {register.name: register for register in gains}
    gains |= {named[name]: value for name, value in joint.settings if name in named}
    position_p = series_of(joint.model).position_p
    if position_p is not None and joint.position_p is not None:
        gains[position_p] = joint.position_p
    return gains


def foreign_gains(joint: Joint, held: Mapping[Register, int]) -> dict[Register, int]:
    """Return the gains that another program has set, which differ from both the robot file and the factory values.

    Args:
        joint: The joint.
        held: Gains that the servo currently holds.

    Returns:
        Value that the servo holds for each of these gains, keyed by register.
    """
    factory, wanted = ram_gains(joint.model), wanted_gains(joint)
    return {r: value for r, value in held.items() if value not in (factory.get(r, wanted[r]), wanted[r])}


def write_gains_in_ram(joint: Joint, bus: Bus) -> None:
    """Write the gains of a joint that differ from those in its servo's RAM, and log gains that another program has set.

    Args:
        joint: The joint.
        bus: Bus of its servo.

    Raises:
        ServoError: A gain could not be read or written.
    """
    wanted = wanted_gains(joint)
    held = {register: retry(partial(bus.read, joint.servo_id, register)) for register in wanted}
    for register, value in wanted.items():
        if held[register] != value:
            retry(partial(bus.write, joint.servo_id, register, value))
    if foreign := foreign_gains(joint, held):
        LOG.warning("%s (servo %d): %s", joint.name, joint.servo_id, foreign_text(joint, foreign))


def foreign_text(joint: Joint, foreign: Mapping[Register, int]) -> str:
    """Describe the gains that another program has left in a servo, and the values that activation writes."""
    wanted = wanted_gains(joint)
    listed = ", ".join(f"{register.name} {value} (now {wanted[register]})" for register, value in foreign.items())
    return (
        f"another program has set different gains in the servo's RAM: {listed}. To keep a gain, write it in the robot "
        "file"
    )
