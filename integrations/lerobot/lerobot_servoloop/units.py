"""Convert between servoloop's positions, in rad or m, and LeRobot's values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lerobot_servoloop.connection import StackError


@dataclass(frozen=True, slots=True)
class JointScale:
    """Linear relation between the position of a joint and its value in LeRobot."""

    zero: float
    """Position at which the value is 0, in rad or m."""
    per_unit: float
    """Change of the position that corresponds to a change of the value by 1, in rad or m."""
    lower: float
    """Lowest position, in rad or m."""
    upper: float
    """Highest position, in rad or m."""

    def value(self, position: float) -> float:
        """Return the value of a position, which is given in rad or m."""
        return (position - self.zero) / self.per_unit

    def position(self, value: float) -> float:
        """Return the position of a value, in rad or m, clipped to the limits of the joint."""
        return min(max(self.zero + value * self.per_unit, self.lower), self.upper)


def joint_scales(arm: Mapping[str, Any], joints: list[str], use_degrees: bool) -> dict[str, JointScale]:
    """Return the scale of each joint.

    Args:
        arm: Reply to the message ``arm``.
        joints: Names of the joints.
        use_degrees: Whether values are in degrees. Otherwise, values from -100 to 100 cover the range between the
            limits. In both cases, the values of the gripper are from 0 (closed limit) to 100 (open limit).

    Raises:
        StackError: The arm has no joint with this name, or a joint has no limits to which values could refer.
    """
    return {joint: _scale(arm, joint, use_degrees) for joint in joints}


def _scale(arm: Mapping[str, Any], joint: str, use_degrees: bool) -> JointScale:
    if joint not in arm["joints"]:
        names = ", ".join(arm["joints"])
        raise StackError("unknown", f"{arm['name']} has no joint {joint!r}: its joints are {names}")
    limits = arm["limits"][joint]
    lower = -math.inf if limits["lower"] is None else float(limits["lower"])
    upper = math.inf if limits["upper"] is None else float(limits["upper"])
    gripper = joint == arm["hand"]
    if use_degrees and not gripper:
        return JointScale(0.0, math.radians(1.0), lower, upper)
    if not math.isfinite(upper - lower):
        raise StackError(
            "input",
            f"{joint} has no limits, so its values cannot be scaled to its range: remove the "
            "joint from the option `joints`",
        )
    if gripper:
        closed, opened = (upper, lower) if _opens_downward(arm) else (lower, upper)
        return JointScale(closed, (opened - closed) / 100.0, lower, upper)
    return JointScale((lower + upper) / 2.0, (upper - lower) / 200.0, lower, upper)


def _opens_downward(arm: Mapping[str, Any]) -> bool:
    """Return whether the gripper opens toward lower positions. Grippers with an unknown direction are assumed to open
    toward higher positions."""
    opened, closed = arm["hand_open"], arm["hand_closed"]
    return opened is not None and closed is not None and opened < closed
