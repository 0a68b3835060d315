"""The error of teleoperation."""

from drivers.errors import DriverError


class TeleopError(DriverError):
    """The two arms cannot be leader and follower."""
