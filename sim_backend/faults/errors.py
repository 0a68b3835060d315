"""Errors in lists of faults."""

from drivers.errors import DriverError


class FaultError(DriverError):
    """Error for faults that cannot be read or cannot be played. The message lists all faulty entries, each with a
    remedy."""
