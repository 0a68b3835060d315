"""Error of a test on a virtual arm."""

from drivers.driver_errors import DriverError


class ArmTestError(DriverError):
    """Raised when a test requests something that the arm cannot do. The message explains how to fix the test."""
