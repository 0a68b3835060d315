"""Errors in lists of faults."""

from drivers.errors import DriverError


class FaultError(DriverError):
    """Faults that cannot be read or cannot be played. The message lists all of them, with a remedy."""
