"""The goals of all actions have one life, upstream's texts for it, and one way through a stall of the loop."""

from enum import Enum
from typing import Final

LONGEST_STEP: Final = 2.0
"""A cycle that comes late moves a goal on by at most so many periods: no leap after a stall."""

NOT_RUNNING: Final = "Can't accept new action goals. Controller is not running."
DEACTIVATED: Final = "Current goal cancelled during deactivate transition."
PREEMPTED: Final = "Current goal preempted by new incoming action."


class GoalStatus(Enum):
    """Life of an accepted goal."""

    EXECUTING = "executing"
    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"
