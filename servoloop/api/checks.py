"""Check goals and targets before the arm moves. All messages name the joint and explain what to do."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from hal.types import AT_LIMIT, JointLimits, beyond_range
from servoloop.api.arm_errors import ArmInputError, ArmSetupError
from servoloop.api.backend import ArmDescription, MotionGoal


def checked_goal(goal: MotionGoal, arm: ArmDescription) -> MotionGoal:
    """Check the names, sizes, times and positions of a goal, and return the goal with its positions within the limits.

    The measured position of a joint that sags or is pushed against its limit may be slightly beyond the limit. A
    position that is only slightly beyond a limit is therefore moved to the limit. Raises ArmInputError.
    """
    check_joints(goal.joints, arm)
    rows = len(goal.times_s)
    if not rows:
        raise ArmInputError("the motion has no points: specify at least one target")
    for kind, table in (("positions", goal.positions), ("velocities", goal.velocities)):
        if (table or kind == "positions") and len(table) != rows:
            raise ArmInputError(f"the motion has {rows} times, but {len(table)} rows of {kind}: send one row per time")
        if any(len(row) != len(goal.joints) for row in table):
            raise ArmInputError(f"a row of {kind} must have {len(goal.joints)} values: {', '.join(goal.joints)}")
    _check_times(goal.times_s)
    for row in goal.velocities:
        for joint, velocity in zip(goal.joints, row, strict=True):
            if not math.isfinite(velocity):
                raise ArmInputError(f"{joint}: velocity {velocity} is not finite: send a finite number", joint)
    positions = []
    for index, row in enumerate(goal.positions):
        at = f" at point {index}" if rows > 1 else ""
        found = zip(goal.joints, row, strict=True)
        positions.append(tuple(_within(joint, position, arm.limits[joint], at) for joint, position in found))
    return replace(goal, positions=tuple(positions))


def checked_targets(targets: Mapping[str, float], arm: ArmDescription) -> dict[str, float]:
    """Check streamed targets in the same way as goal positions, and return them within the limits. Raises
    ArmInputError."""
    check_joints(targets, arm)
    return {joint: _within(joint, position, arm.limits[joint]) for joint, position in targets.items()}


def check_joints(joints: Iterable[str], arm: ArmDescription) -> None:
    """Check that the arm has these joints and that no joint is listed twice. Raises ArmInputError."""
    named = tuple(joints)
    if not named:
        raise ArmInputError(f"no joint is specified: specify at least one of {', '.join(arm.joints)}")
    for joint in named:
        if joint not in arm.joints:
            raise ArmInputError(
                f"{arm.name} has no joint {joint!r}: its joints are {', '.join(arm.joints)}", str(joint)
            )
        if named.count(joint) > 1:
            raise ArmInputError(f"{joint} is listed twice: list each joint once", joint)


def checked_number(name: str, value: object) -> float:
    """Convert a value to a number. Raises ArmInputError if it is a string, a Boolean or not a number."""
    found = number_of(value)
    if found is None:
        raise ArmInputError(f"{name} must be a number, not {value!r}")
    return found


def checked_numbers(name: str, values: Any, count: int) -> tuple[float, ...]:
    """Convert a sequence to numbers. Raises ArmInputError if it does not contain ``count`` numbers."""
    try:
        found = [number_of(value) for value in values]
    except TypeError:  # not a sequence, or an array without dimensions
        found = []
    numbers = tuple(value for value in found if value is not None)
    if len(found) != count or len(numbers) != count:
        raise ArmInputError(f"{name} must consist of {count} numbers, not {values!r}")
    return numbers


def checked_timeout(value: object) -> float:
    """Return a maximum time to wait, in seconds, which may be infinite. Raises ArmInputError if it is not a number."""
    found = checked_number("timeout", value)
    if math.isnan(found):
        raise ArmInputError(f"timeout must be a time in seconds, not {value!r}")
    return found


def check_boolean(name: str, value: object) -> None:
    """Raise ArmInputError if a value is not a Boolean, because a text such as "off" would count as true."""
    if not isinstance(value, bool):
        raise ArmInputError(f"{name} must be True or False, not {value!r}: pass a Boolean")


def checked_path(name: str, value: object) -> Path:
    """Convert a value to a path. Raises ArmSetupError."""
    if not isinstance(value, str | Path):
        raise ArmSetupError(f"{name} must be a path, not {value!r}: pass a string or a Path")
    return Path(value)


def checked_ports(port: object) -> list[str]:
    """Convert the ports of an arm to a list. Raises ArmSetupError."""
    ports = [port] if isinstance(port, str) else [] if port is None else port
    if not (isinstance(ports, Sequence) and all(isinstance(one, str) for one in ports)):
        raise ArmSetupError(f"port must be a string or a list of strings such as '/dev/ttyACM0', not {port!r}")
    return list(ports)


def number_of(value: Any) -> float | None:
    """Return a value as a number, or None if the value is a string, a Boolean (including NumPy's) or not a number.

    A whole number beyond the range of a float becomes infinite.
    """
    if isinstance(value, str | bytes) or type(value).__name__.startswith("bool"):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    except (TypeError, ValueError):
        return None


def _within(joint: str, position: float, limit: JointLimits, at: str = "") -> float:
    """Return a position clipped to its limits. Raises ArmInputError if the position is not finite or clearly beyond a
    limit."""
    if not math.isfinite(position):
        raise ArmInputError(f"{joint}: position {position}{at} is not finite: send a finite number", joint)
    slack = AT_LIMIT * (limit.upper - limit.lower)
    if limit.lower - slack <= position <= limit.upper + slack:
        return min(max(position, limit.lower), limit.upper)
    shown, lower, upper = beyond_range(position, limit.lower, limit.upper)
    raise ArmInputError(
        f"{joint}: position {shown}{at} is outside the limits {lower} to {upper}: choose a position within them", joint
    )


def _check_times(times_s: tuple[float, ...]) -> None:
    if not all(math.isfinite(time_s) and time_s >= 0.0 for time_s in times_s):
        raise ArmInputError("all times must be finite and not negative: measure the times from the start of the motion")
    for index, (before_s, time_s) in enumerate(pairwise(times_s)):
        if time_s <= before_s:
            raise ArmInputError(
                f"time {time_s:g} s at point {index + 1} is not after {before_s:g} s: times must increase strictly"
            )
