"""Determine the result of a trajectory goal. The result strings are the same as in ros2_control."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.action_goals import GoalStatus
from controller.motion import MotionError, Path, stretched
from controller.trajectory.tolerances import Tolerances, excess
from hal.types import FloatArray

LOG = logging.getLogger("servoloop.controller")

PREEMPTED_BY_TOPIC: Final = "Current goal preempted by a trajectory on the topic joint_trajectory."
"""Result string of a goal that is replaced by a trajectory on the topic. The behavior intentionally differs from that
of ros2_control. In ros2_control, the goal succeeds with a trajectory that the goal's client never sent.
"""


class ErrorCode:
    """Values of ``error_code`` in control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


@dataclass(frozen=True, slots=True)
class GoalResult:
    """Final status of a goal, with the error code and the message for its client."""

    status: GoalStatus
    error_code: int
    text: str
    stop: bool = True
    """Whether the joints must stop, because they are still moving or are not at their goal."""
    at_rest: bool = False
    """Whether the result is reported only after the joints are at rest and do not press against an obstacle."""


CANCELED: Final = GoalResult(GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "", at_rest=True)
TIMED_OUT: Final = GoalResult(
    GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, "Aborted due to command timeout", at_rest=True
)


def result_at_end(
    joints: Sequence[str], tolerances: Tolerances, path: Path, after_end_s: float, error: FloatArray
) -> GoalResult | None:
    """Return the result of a goal ``after_end_s`` after its path ended, or None if joints are still moving.

    ``error`` (n,) is the reference minus the latest measurement.
    """
    off = excess(joints, error, tolerances.goal)
    if not off:
        return GoalResult(GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL, _success(path), stop=False)
    if 0.0 < tolerances.goal_time_s < after_end_s:
        text = f"Aborted due to goal_time_tolerance exceeding by {after_end_s:f} seconds: {off}"
        return GoalResult(GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, text, at_rest=True)
    return None


def cannot_begin(controller: str, error: Exception) -> GoalResult:
    """Return the result of a goal whose plan cannot be joined. Errors other than MotionError are logged as defects."""
    if not isinstance(error, MotionError):
        LOG.error("%s: the goal cannot start", controller, exc_info=error)
    text = str(error) if isinstance(error, MotionError) else f"the goal cannot start: {error!r}"
    return GoalResult(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text)


def path_violated(off: str) -> GoalResult:
    """Return the result of a goal whose joints left its path. ``off`` describes the joint and the deviation."""
    text = f"Aborted due to path tolerance violation: {off}"
    return GoalResult(GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, text, at_rest=True)


def _success(path: Path) -> str:
    text = "Goal successfully reached!"
    if stretched(path):
        text += f" The limits stretched the motion from {path.asked_s:.2f} s to {path.duration_s:.2f} s."
    return text
