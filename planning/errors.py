"""Errors of motion planning.

PlanningError
├── GoalError       the goal of a client is invalid or cannot be reached
└── GroupsError     an SRDF file has mistakes, or a group or state does not exist
"""

from typing import Literal

Code = Literal[
    "INVALID_GROUP_NAME",
    "INVALID_LINK_NAME",
    "INVALID_ROBOT_STATE",
    "INVALID_GOAL_CONSTRAINTS",
    "GOAL_IN_COLLISION",
    "NO_IK_SOLUTION",
]
"""Names of the codes in moveit_msgs/MoveItErrorCodes."""


class PlanningError(Exception):
    """Base class of all errors of this package. The message is one sentence for the user."""

    def __init__(self, message: str, code: Code) -> None:
        super().__init__(message)
        self.code: Code = code
        """Name of the code in moveit_msgs/MoveItErrorCodes."""
