"""Errors in lists of faults."""

from drivers.driver_errors import DriverError


class FaultError(DriverError):
    """Raised when faults cannot be read or cannot be played. The message lists all faulty entries and how to fix each
    of them."""
