"""The rates that tools take: a slip of the finger is no reason to wait for minutes, nor a number for no port."""

from typing import Final

SMALLEST_BAUD: Final = 1_200
"""Below the smallest that any servo knows."""
LARGEST_BAUD: Final = 12_000_000
"""Of the fastest USB adapters."""
