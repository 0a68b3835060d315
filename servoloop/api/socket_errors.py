"""Convert arm errors to command socket errors, and back."""

from collections.abc import Mapping
from typing import Final

from servoloop.api.arm_errors import (
    ArmBusyError,
    ArmEndedError,
    ArmError,
    ArmInputError,
    ArmTimeoutError,
    MotionCanceledError,
    MotionFailedError,
    StreamEndedError,
)
from servoloop.command_socket.command_errors import CommandError, ErrorKind

_CLASSES: Final[Mapping[ErrorKind, type[ArmError]]] = {
    "motion_canceled": MotionCanceledError,
    "motion_failed": MotionFailedError,
    "input": ArmInputError,
    "busy": ArmBusyError,
    "stream_ended": StreamEndedError,
    "timeout": ArmTimeoutError,
    "ended": ArmEndedError,
    "failed": ArmError,
}
"""Error class for each error type. Each class precedes its base class."""
_OTHERS: Final[Mapping[ErrorKind, type[ArmError]]] = {
    "owned": ArmBusyError,
    "not_owner": ArmBusyError,
    "unknown": ArmInputError,
    "rejected": ArmInputError,
    "malformed": ArmInputError,
    "too_large": ArmInputError,
}


def command_error(error: ArmError) -> CommandError:
    """Return the error that a stack sends to a client."""
    kind: ErrorKind = next(kind for kind, one in _CLASSES.items() if isinstance(error, one))
    return CommandError(kind, str(error), error.joint)


def arm_error(error: CommandError) -> ArmError:
    """Return the error that a program receives."""
    kind = _CLASSES.get(error.kind) or _OTHERS.get(error.kind, ArmError)
    return kind(str(error), error.joint)
