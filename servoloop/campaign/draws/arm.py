"""Draw random differences between an arm and its files. A joint is outside its limits, a servo has a different setting
at the start, or a hand stops as if it held an object."""

from collections.abc import Mapping, Sequence
from random import Random
from typing import Final

from drivers.servos import x
from drivers.servos.catalog import registers_of
from hal.joint import Joint
from hal.types import OUTSIDE_TOLERANCE, JointLimits
from sim_backend.faults.mechanics import Jammed
from sim_backend.faults.settings import WrongSetting
from sim_backend.faults.tables import any_value

NARROWED: Final = 0.15
"""Fraction of the runs in which a joint has narrower limits."""
FAR: Final = 0.2
"""Fraction of the runs with narrower limits in which the joint is too far outside its limits to be activated."""
NARROWEST: Final = 0.3
"""Minimum remaining range, as a fraction of the joint's range."""
OTHER_SETTING: Final = 0.1
"""Fraction of the runs in which a servo setting differs from the robot file. Activation corrects the setting."""

NEWER_FIRMWARE: Final = 53
"""Firmware version from which all Dynamixels X of the shipped arms support fast sync reads of their indirect
registers."""
NEWER: Final = 0.5
"""Fraction of the runs in which Dynamixels have this firmware version."""

HOLDS_OBJECT: Final = 0.7
"""Fraction of the runs with gripper goals in which the hand jams once, as if it held an object."""
OBJECT_S: Final = (3.0, 8.0)
"""Range of the time for which the hand is jammed, in seconds."""


def draw_limits(
    seed: int, joints: Mapping[str, JointLimits], positions: Mapping[str, float], park: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Return the narrower limits (lower, upper) of at most one joint, in rad or m, keyed by joint name.

    Args:
        seed: Seed of the run.
        joints: Limits of the joints, keyed by joint name.
        positions: Positions of the joints at the start of the run, in rad or m, keyed by joint name.
        park: Park pose in rad or m, keyed by joint name. The pose stays within the limits.
    """
    random = Random(f"{seed}/limits")
    if random.random() >= NARROWED:
        return {}
    outside = random.uniform(1.3, 4.0) if random.random() < FAR else random.uniform(0.1, 0.9)
    outside *= OUTSIDE_TOLERANCE  # as a fraction of the remaining range
    ranges = [
        (name, (max(round(least, 4), limit.lower), min(round(greatest, 4), limit.upper)))
        for name, limit in joints.items()
        for least, greatest in _ranges(limit, positions[name], outside)
        if name not in park or least < park[name] < greatest
    ]
    return dict([random.choice(ranges)]) if ranges else {}


def _ranges(limit: JointLimits, position: float, outside: float) -> list[tuple[float, float]]:
    """Return up to two ranges that a position exceeds, above or below, by the fraction ``outside`` of the range."""
    lower, upper = limit.lower, limit.upper
    most = NARROWEST * (upper - lower)
    below = (lower, lower + (position - lower) / (1.0 + outside))
    above = (upper - (upper - position) / (1.0 + outside), upper)
    return [(least, greatest) for least, greatest in (below, above) if most < greatest - least < upper - lower]


def draw_firmware(seed: int, joints: Sequence[Joint]) -> int | None:
    """Return the firmware version of the arm's Dynamixels, or None for the usual version.

    Args:
        seed: Seed of the run.
        joints: All joints of the arm.
    """
    newer = any(joint.model in x.MODELS.values() for joint in joints) and Random(f"{seed}/firmware").random() < NEWER
    return NEWER_FIRMWARE if newer else None


def draw_setting(seed: int, joints: Sequence[Joint]) -> tuple[WrongSetting, ...]:
    """Return at most one setting of the robot file for which a servo has a wrong value when the stack starts.

    Args:
        seed: Seed of the run.
        joints: All joints of the arm.
    """
    random = Random(f"{seed}/setting")
    known = [(joint, name, value) for joint in joints for name, value in joint.settings]
    if not known or random.random() >= OTHER_SETTING:
        return ()
    joint, name, wanted = random.choice(known)
    register = next(register for register in registers_of(joint.model) if register.name == name)
    value = any_value(random, register)
    if not register.persistent or value == wanted:
        return ()
    servo_id, bus = joint.servo_id, joint.bus or None
    return (WrongSetting(since="start", at_s=0.0, servo_id=servo_id, bus=bus, register_name=name, value=value),)


def draw_jam(seed: int, hands: Sequence[Joint], within_s: float) -> tuple[Jammed, ...]:
    """Return at most one jam of a hand, which ends a gripper goal as stalled.

    Args:
        seed: Seed of the run.
        hands: Joints of the hand that have servos.
        within_s: Time within which the jam begins, in seconds.
    """
    random = Random(f"{seed}/jam")
    if not hands or random.random() >= HOLDS_OBJECT:
        return ()
    hand = hands[0]
    at_s, for_s = round(random.uniform(0.0, within_s), 3), round(random.uniform(*OBJECT_S), 2)
    return (Jammed(at_s=at_s, servo_id=hand.servo_id, bus=hand.bus or None, for_s=for_s),)
