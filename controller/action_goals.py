"""Define the goal states, result strings and step limit that all action controllers share."""

from enum import Enum
from typing import Final

LONGEST_STEP: Final = 2.0
"""Maximum time by which one cycle may advance a goal, in periods. This limit prevents a jump after the loop has
stalled.
"""

NOT_RUNNING: Final = "Can't accept new action goals. Controller is not running."
DEACTIVATED: Final = "Current goal cancelled during deactivate transition."
PREEMPTED: Final = "Current goal preempted by new incoming action."


class GoalStatus(Enum):
    """State of an accepted goal."""

    EXECUTING = "executing"
    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"
