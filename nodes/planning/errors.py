"""Errors of requests, and their messages with MoveIt's codes."""

import traceback
from pathlib import Path
from typing import Any, Final

from moveit_msgs.msg import MoveItErrorCodes

from drivers.printable import printable_line
from planning.errors import PlanningError

SOURCE: Final = "servoloop"
"""Name of this server in the error codes that it sends."""


class RequestError(Exception):
    """A request cannot be carried out. The message names the cause and the remedy."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        """Name of the error code in moveit_msgs/MoveItErrorCodes."""


REFUSALS: Final = (RequestError, PlanningError)
"""Errors whose messages are for the client."""


def success() -> MoveItErrorCodes:
    """Return the code of a request that was carried out."""
    return MoveItErrorCodes(val=MoveItErrorCodes.SUCCESS, source=SOURCE)


def error_code(error: RequestError | PlanningError) -> MoveItErrorCodes:
    """Return the code of an error, with its message."""
    return coded(error.code, str(error))


def crash(log: Any, error: Exception) -> MoveItErrorCodes:
    """Return the code of an error that no request should cause, and write its place to the log for a report."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(frame.filename).name}, line {frame.lineno}"
    message = f"internal error, please report it: {type(error).__name__}: {error} ({place})"
    log.error(printable_line(message))
    return coded("CRASH", message)


def coded(code: str, message: str) -> MoveItErrorCodes:
    """Return a code by its name, with a message."""
    return MoveItErrorCodes(val=getattr(MoveItErrorCodes, code), message=printable_line(message), source=SOURCE)
