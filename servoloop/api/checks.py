"""Check goals and targets before anything moves. All messages name the joint and the remedy."""

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Final

from hal.types import JointLimits, beyond_range
from servoloop.api.backend import ArmDescription, JointGoal
from servoloop.api.errors import ArmInputError

ROUNDING: Final = 1e-6
"""Share of a limit by which a position may exceed the limit, as for goals over ROS. Planners plan up to the limits."""


def check_goal(goal: JointGoal, arm: ArmDescription) -> None:
    """Check the names, sizes, times and positions of a goal. Raises ArmInputError."""
    check_joints(goal.joints, arm)
    rows = len(goal.times_s)
    if not rows:
        raise ArmInputError("the motion has no points: name at least one target")
    for kind, table in (("positions", goal.positions), ("velocities", goal.velocities)):
        if (table or kind == "positions") and len(table) != rows:
            raise ArmInputError(f"the motion has {rows} times, but {len(table)} rows of {kind}: send one row per time")
        if any(len(row) != len(goal.joints) for row in table):
            raise ArmInputError(f"a row of {kind} must have {len(goal.joints)} values: {', '.join(goal.joints)}")
    _check_times(goal.times_s)
    for index, row in enumerate(goal.positions):
        at = f" at point {index}" if rows > 1 else ""
        for joint, position in zip(goal.joints, row, strict=True):
            check_position(joint, position, arm.limits[joint], at)
    for row in goal.velocities:
        for joint, velocity in zip(goal.joints, row, strict=True):
            if not math.isfinite(velocity):
                raise ArmInputError(f"{joint}: velocity {velocity} is not finite: send a number", joint)


def check_targets(targets: Mapping[str, float], arm: ArmDescription) -> None:
    """Check the names and the positions of streamed targets. Raises ArmInputError."""
    check_joints(targets, arm)
    for joint, position in targets.items():
        check_position(joint, position, arm.limits[joint])


def check_joints(joints: Iterable[str], arm: ArmDescription) -> None:
    """Check that the arm has these joints and that no joint is named twice. Raises ArmInputError."""
    named = tuple(joints)
    if not named:
        raise ArmInputError(f"no joint is named: name at least one of {', '.join(arm.joints)}")
    for joint in named:
        if joint not in arm.joints:
            raise ArmInputError(
                f"{arm.name} has no joint {joint!r}: its joints are {', '.join(arm.joints)}", str(joint)
            )
        if named.count(joint) > 1:
            raise ArmInputError(f"{joint} is named twice: name each joint once", joint)


def check_position(joint: str, position: float, limit: JointLimits, at: str = "") -> None:
    """Check that a position is finite and within the limits. Raises ArmInputError."""
    if not math.isfinite(position):
        raise ArmInputError(f"{joint}: position {position}{at} is not finite: send a number", joint)
    if not _beyond(limit.lower, position) and not _beyond(-limit.upper, -position):
        return
    shown, lower, upper = beyond_range(position, limit.lower, limit.upper)
    raise ArmInputError(
        f"{joint}: position {shown}{at} is outside the limits {lower} to {upper}: choose a position between them", joint
    )


def _beyond(lower: float, position: float) -> bool:
    """Return whether a position is below its lower limit by more than a planner's rounding error."""
    return position < lower - ROUNDING * abs(lower)


def _check_times(times_s: tuple[float, ...]) -> None:
    if not all(math.isfinite(time_s) and time_s >= 0.0 for time_s in times_s):
        raise ArmInputError("all times must be finite and not negative: count them from the start of the motion")
    for index, (before_s, time_s) in enumerate(pairwise(times_s)):
        if time_s <= before_s:
            raise ArmInputError(
                f"time {time_s:g} s at point {index + 1} is not after {before_s:g} s: times must increase strictly"
            )
