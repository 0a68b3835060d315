"""Errors of the commissioning tools, and the accepted baud rates."""

from typing import Final

from drivers.errors import DriverError


class CommissioningError(DriverError):
    """A tool cannot carry out its task. The message tells the user what to do."""


class CalibrationError(Exception):
    """The calibration cannot be finished. The message tells the user what to do."""


SMALLEST_BAUD: Final = 1_200
"""Minimum accepted baud rate, below the smallest rate of any servo."""
LARGEST_BAUD: Final = 12_000_000
"""Maximum accepted baud rate, which the fastest USB adapters support."""
