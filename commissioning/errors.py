"""The error of the commissioning tools, and the accepted baud rates."""

from typing import Final

from drivers.errors import DriverError


class CommissioningError(DriverError):
    """A tool cannot carry out its task; the message states the remedy."""


SMALLEST_BAUD: Final = 1_200
"""Smallest accepted baud rate, below the smallest rate of any servo."""
LARGEST_BAUD: Final = 12_000_000
"""Largest accepted baud rate, that of the fastest USB adapters."""
