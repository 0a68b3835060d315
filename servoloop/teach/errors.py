"""The error of teaching and replaying."""

from drivers.errors import DriverError


class TeachError(DriverError):
    """The arm cannot be taught so, or what was taught cannot be played on it."""
