"""Errors of this layer; the drivers' own pass through it.

HalError
├── DescriptionError   the URDF
├── RobotFileError     the robot file
├── ArmFileError       an arm's folder
├── LifecycleError     a call that this state does not allow
└── ActivationError    torque may not go on now

PartLost is a PortLost of the drivers: one of several lines is gone.
"""

from drivers.errors import PortLost


class HalError(Exception):
    """Base of all errors of this package. The text says what to do."""


class DescriptionError(HalError):
    """The URDF is missing something or contradicts itself."""


class RobotFileError(HalError):
    """The robot file has mistakes; the text lists all of them."""


class ArmFileError(HalError):
    """There is no such arm, or its folder has mistakes; the text lists all of them."""


class LifecycleError(HalError):
    """The hardware's state does not allow this call."""


class ActivationError(HalError):
    """Torque may not go on now."""


class PartLost(PortLost):
    """A line is gone and the others have been told what they were to be told."""
