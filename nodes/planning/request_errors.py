"""Request errors, and messages with MoveIt's error codes."""

import traceback
from pathlib import Path
from typing import Any, Final

from moveit_msgs.msg import MoveItErrorCodes

from drivers.printable import printable_line
from planning.planning_errors import PlanningError

SOURCE: Final = "servoloop"
"""Name of this server, sent as the source of its error codes."""


class RequestError(Exception):
    """Error for a request that cannot be carried out. The message explains the cause and what the client can do."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        """Name of the error code in moveit_msgs/MoveItErrorCodes."""


REFUSALS: Final = (RequestError, PlanningError)
"""Errors whose messages are sent to the client."""


def success() -> MoveItErrorCodes:
    """Return the error code of a successful request."""
    return MoveItErrorCodes(val=MoveItErrorCodes.SUCCESS, source=SOURCE)


def error_code(error: RequestError | PlanningError) -> MoveItErrorCodes:
    """Return the error code of an exception, with its message."""
    return coded(error.code, str(error))


def crash(log: Any, error: Exception) -> MoveItErrorCodes:
    """Log the traceback of an exception for a bug report, and return the error code of an internal error."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(frame.filename).name}, line {frame.lineno}"
    message = f"internal error, please report it: {type(error).__name__}: {error} ({place})"
    log.error(printable_line(message))
    return coded("CRASH", message)


def coded(code: str, message: str) -> MoveItErrorCodes:
    """Return the error code with the given name and a message."""
    return MoveItErrorCodes(val=getattr(MoveItErrorCodes, code), message=printable_line(message), source=SOURCE)
