"""Result of an execution."""

from dataclasses import dataclass
from typing import Final

from moveit_msgs.msg import MoveItErrorCodes

_STATUS: Final = {
    MoveItErrorCodes.SUCCESS: "SUCCEEDED",
    MoveItErrorCodes.PREEMPTED: "PREEMPTED",
    MoveItErrorCodes.TIMED_OUT: "TIMED_OUT",
    MoveItErrorCodes.CONTROL_FAILED: "ABORTED",
}


@dataclass(frozen=True, slots=True)
class ExecutionStatus:
    """Result of an execution, which is true if it succeeded."""

    error_code: MoveItErrorCodes

    @property
    def status(self) -> str:
        """Status with MoveIt's name, such as "SUCCEEDED"."""
        return _STATUS.get(self.error_code.val, "FAILED")

    def __bool__(self) -> bool:
        """Return whether the execution succeeded."""
        return self.status == "SUCCEEDED"
