"""The check of a calibration: each joint moves a little under torque, slowly, and comes to where it was sent."""

from collections.abc import Callable
from typing import Final

from commissioning.calibrate.result import CalibrationError
from commissioning.slow_arm import SlowArm

WAY_RAD: Final = 0.2
"""How far each servo turns, there and back."""
OFF_SHARE: Final = 0.3
"""Sag is the same at both ends of the way; so much of it may be missing by friction and dead band."""


def check(arm: SlowArm, say: Callable[[str], None]) -> None:
    """Move every joint there and back. Raises CalibrationError with the joint that does not follow."""
    for index, joint in enumerate(arm.joints):
        say(f"{joint.name} moves")
        _there_and_back(arm, index)


def first_way(arm: SlowArm, index: int) -> float:
    """The way that the check moves a joint first, towards the middle of its limits, rad or m."""
    joint = arm.joints[index]
    middle = 0.5 * (joint.limits.lower + joint.limits.upper)
    return WAY_RAD * joint.transmission * (1.0 if float(arm.command[index]) < middle else -1.0)


def _there_and_back(arm: SlowArm, index: int) -> None:
    joint, start, before = arm.joints[index], float(arm.command[index]), arm.measured(index)
    way = first_way(arm, index)
    arm.go(index, start + way)
    moved = arm.measured(index) - before
    arm.go(index, start)
    if abs(moved - way) > OFF_SHARE * abs(way):
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) was to move by {way:+.3f} and moved by {moved:+.3f}: "
            "is something in its way, is it at a stop, or is its calibration wrong?"
        )
