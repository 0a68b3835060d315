"""Errors of the hardware layer. Errors of the drivers pass through the hardware layer unchanged.

HalError
├── DescriptionError   errors in the URDF
├── RobotFileError     errors in the robot file
├── ArmFileError       errors in the folder of an arm
├── LifecycleError     the life cycle state does not allow the call
└── ActivationError    torque must not be enabled now

PartLost is a subclass of the driver layer's PortLost: one of several buses is lost.
"""

from drivers.driver_errors import PortLost


class HalError(Exception):
    """Base class of all errors of this package. The message tells the user what to do."""


class DescriptionError(HalError):
    """The URDF is incomplete or contradicts itself."""


class RobotFileError(HalError):
    """The robot file contains errors. The message lists all of them."""


class ArmFileError(HalError):
    """The arm does not exist, or its folder contains errors. The message lists all of them."""


class LifecycleError(HalError):
    """The life cycle state of the hardware does not allow the call."""


class ActivationError(HalError):
    """Torque must not be enabled now."""


class PartLost(PortLost):
    """One of several buses is lost. The commands for the other buses have been sent."""
