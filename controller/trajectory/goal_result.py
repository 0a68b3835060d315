"""A goal's result: the way in which it ended, and the decision at the end of its path. The texts are upstream's."""

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
"""Ours, on purpose: upstream lets the goal succeed with a trajectory that its client never sent."""


class ErrorCode:
    """error_code of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


@dataclass(frozen=True, slots=True)
class GoalResult:
    """The end of a goal. ``stop``: the joints are still on their way, or not where they should be.

    ``at_rest``: the goal ends once the joints rest and press against nothing.
    """

    status: GoalStatus
    error_code: int
    text: str
    stop: bool = True
    at_rest: bool = False


CANCELED: Final = GoalResult(GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "", at_rest=True)
TIMED_OUT: Final = GoalResult(
    GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, "Aborted due to command timeout", at_rest=True
)


def result_at_end(
    joints: Sequence[str], tolerances: Tolerances, path: Path, after_end_s: float, error: FloatArray
) -> GoalResult | None:
    """The goal's result so long after its path's end, or None while the joints may still come nearer.

    ``error`` (n,) is the reference less what was measured last.
    """
    off = excess(joints, error, tolerances.goal)
    if not off:
        return GoalResult(GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL, _success(path), stop=False)
    if 0.0 < tolerances.goal_time_s < after_end_s:
        text = f"Aborted due to goal_time_tolerance exceeding by {after_end_s:f} seconds: {off}"
        return GoalResult(GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, text, at_rest=True)
    return None


def cannot_begin(controller: str, error: Exception) -> GoalResult:
    """The result of a goal whose plan cannot be joined; what is no MotionError is a defect, and logged as one."""
    if not isinstance(error, MotionError):
        LOG.error("%s: a goal cannot begin", controller, exc_info=error)
    text = str(error) if isinstance(error, MotionError) else f"the goal cannot begin: {error!r}"
    return GoalResult(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text)


def path_violated(off: str) -> GoalResult:
    """The result of a goal whose joints are too far from its path; ``off`` says which, and by how much."""
    text = f"Aborted due to path tolerance violation: {off}"
    return GoalResult(GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, text, at_rest=True)


def _success(path: Path) -> str:
    text = "Goal successfully reached!"
    if stretched(path):
        text += f" The limits stretched it from {path.asked_s:.2f} s to {path.duration_s:.2f} s."
    return text
