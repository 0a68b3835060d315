"""Planning errors, with the names of MoveIt's error codes."""

from typing import Literal

Code = Literal[
    "START_STATE_IN_COLLISION",
    "START_STATE_INVALID",
    "START_STATE_VIOLATES_PATH_CONSTRAINTS",
    "FRAME_TRANSFORM_FAILURE",
    "GOAL_IN_COLLISION",
    "GOAL_STATE_INVALID",
    "INVALID_GOAL_CONSTRAINTS",
    "INVALID_GROUP_NAME",
    "GOAL_VIOLATES_PATH_CONSTRAINTS",
    "INVALID_LINK_NAME",
    "INVALID_MOTION_PLAN",
    "INVALID_OBJECT_NAME",
    "INVALID_ROBOT_STATE",
    "NO_IK_SOLUTION",
    "PLANNING_FAILED",
    "TIMED_OUT",
]


class PlanningError(Exception):
    """No plan was found. The message names the joint, link or object, and explains what to do."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code: Code = code
        """Name of the error code in moveit_msgs/MoveItErrorCodes."""
