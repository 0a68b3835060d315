"""What the tools refuse or cannot do, in words for whoever called them."""

from typing import Final

from drivers.errors import DriverError


class CommissioningError(DriverError):
    """The text says what to do."""


SMALLEST_BAUD: Final = 1_200
"""Below the smallest that any servo knows."""
LARGEST_BAUD: Final = 12_000_000
"""Of the fastest USB adapters."""
