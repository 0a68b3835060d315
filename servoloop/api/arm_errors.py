"""Errors raised by ``servoloop.Arm``.

ArmError
├── ArmSetupError      the arm cannot be started
├── ArmInputError      a target, a path or an argument is invalid, and nothing has moved
│   └── PlanFailedError    no motion around the obstacles was found
├── ArmBusyError       another program or another call moves the arm
├── MotionFailedError  a motion stopped before it reached its target
│   └── MotionCanceledError  a motion was canceled or replaced
├── StreamEndedError   a stream received no target for too long, or was closed
├── ArmTimeoutError    a wait took too long
└── ArmEndedError      the control loop has ended
"""

from drivers.driver_errors import DriverError


class ArmError(DriverError):
    """Base class for all errors raised by ``servoloop.Arm``. The message tells the user what to do."""

    def __init__(self, text: str, joint: str = "") -> None:
        """Create an error.

        Args:
            text: Problem and remedy, in one sentence.
            joint: Name of the affected joint, or empty if the error does not concern a single joint.
        """
        super().__init__(text)
        self.joint = joint


class ArmSetupError(ArmError):
    """The arm cannot be started. The message names the file, the port or the servo."""


class ArmInputError(ArmError, ValueError):
    """A target, a path or an argument is invalid. This call has not moved the arm."""


class PlanFailedError(ArmInputError):
    """No motion around the obstacles was found. The message names the links, the joint or the object."""

    def __init__(self, text: str, joint: str = "", code: str = "PLANNING_FAILED") -> None:
        """Create an error.

        Args:
            text: Problem and remedy, in one sentence.
            joint: Name of the affected joint; empty if the error does not concern a single joint.
            code: Name of the MoveIt error code.
        """
        super().__init__(text, joint)
        self.code = code


class ArmBusyError(ArmError):
    """Another program or another call moves the arm."""


class MotionFailedError(ArmError):
    """A motion stopped before it reached its target, for example because a joint is blocked. The arm holds its
    position."""


class MotionCanceledError(MotionFailedError):
    """A motion was canceled or replaced by another motion."""


class StreamEndedError(ArmError):
    """No target arrived within a stream's time limit, or the stream was closed. The arm holds its position."""


class ArmTimeoutError(ArmError, TimeoutError):
    """A wait took longer than its timeout. The motion continues."""


class ArmEndedError(ArmError):
    """The control loop has ended, so this program can no longer move the arm."""
