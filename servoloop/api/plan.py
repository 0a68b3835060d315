"""Durations of motions at a share of the velocity limits."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from hal.types import JointLimits
from servoloop.api.errors import ArmInputError

SHORTEST_S: Final = 1e-3
"""Duration of a motion whose joints are at their targets already, in seconds."""


def approach_s(
    target: Mapping[str, float], start: Mapping[str, float], limits: Mapping[str, JointLimits], speed: float
) -> float:
    """Return the duration of a jerk-limited motion between two poses at rest, in seconds.

    Args:
        target: Target positions by joint, in rad or m.
        start: Start positions by joint, in rad or m. Joints with an unknown start are ignored.
        limits: Limits by joint.
        speed: Share of the velocity limits, above 0 and at most 1.

    Raises:
        ArmInputError: No motion within the limits connects the poses.
    """
    import numpy as np

    from controller.motion import Kinematics, MotionError, motion_to

    joints = [joint for joint in target if math.isfinite(start[joint])]
    if not joints:
        return SHORTEST_S
    slower = [replace(limits[joint], velocity=speed * limits[joint].velocity) for joint in joints]
    here = Kinematics.at_rest(np.array([start[joint] for joint in joints]))
    there = Kinematics.at_rest(np.array([target[joint] for joint in joints]))
    try:
        return max(motion_to(here, there, slower, 0.0, joints).duration_s, SHORTEST_S)
    except MotionError as error:
        raise ArmInputError(f"the arm cannot move to the target: {error}") from error
