"""The error of looking on."""

from drivers.errors import DriverError


class LiveError(DriverError):
    """There is nothing to look at, or it cannot be reached."""
