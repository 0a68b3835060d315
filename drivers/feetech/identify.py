"""Whether a servo is what the robot file says, and set up so that we can drive it."""

import logging
from functools import partial
from typing import Final

from drivers.errors import ServoRefused, ServoSilent
from drivers.feetech import sts
from drivers.readings import refuse_stranger
from drivers.registers import Register, ServoModel
from drivers.single_servo import SingleServo
from drivers.tries import tried

LOG = logging.getLogger("servoloop.drivers")

_POSITION_MODE: Final = 0


def identify(single: SingleServo, servo_id: int, model: ServoModel) -> None:
    """Raise ServoSilent or ServoRefused with a text that says what to do."""
    refuse_stranger(servo_id, tried(partial(single.read, servo_id, sts.model_number)), model, sts.MODELS)


def check_settings(single: SingleServo, servo_id: int, port_name: str) -> None:
    """Raise ServoRefused where goals are not what we take them for, or writes are not acknowledged."""

    def read(register: Register) -> int:
        return tried(partial(single.read, servo_id, register))

    if read(sts.operating_mode) != _POSITION_MODE:
        mode = sts.operating_mode
        raise ServoRefused(servo_id, f"is not in position mode: set {mode.name} ({mode.address}) to {_POSITION_MODE}")
    if not read(sts.status_level) and not _acknowledges(single, servo_id, read(sts.acceleration)):
        level = sts.status_level
        raise ServoRefused(servo_id, f"acknowledges no writes: set its {level.name} (register {level.address}) to 1")
    phase = read(sts.phase)
    if not phase & sts.COUNTS_PER_S_PHASE:
        # A simulator may have an empty table and be right all the same: no reason to refuse.
        LOG.warning(
            "%s: servo %d: phase (register %d) is %d: by Feetech's table its unit of speed is then 50 counts/s. "
            "Every speed is taken and given for 1 count/s: set it to %d",
            port_name, servo_id, sts.phase.address, phase, phase | sts.COUNTS_PER_S_PHASE,
        )  # fmt: skip


def _acknowledges(single: SingleServo, servo_id: int, acceleration: int) -> bool:
    """Whether it answers a write, by one that changes nothing: a simulator with an empty table may."""
    try:
        tried(partial(single.write, servo_id, sts.acceleration, acceleration))
    except ServoSilent:
        return False
    return True
