"""Errors raised by the commissioning tools, and the range of accepted baud rates."""

from typing import Final

from drivers.driver_errors import DriverError


class CommissioningError(DriverError):
    """A tool cannot perform its task. The message tells the user what to do."""


class CalibrationError(Exception):
    """The calibration cannot be completed. The message tells the user what to do."""


def text_with_notes(error: BaseException) -> str:
    """Return the message of an exception, followed by its notes."""
    return "; ".join([str(error), *getattr(error, "__notes__", ())])


SMALLEST_BAUD: Final = 1_200
"""Minimum accepted baud rate, below the lowest rate of any servo."""
LARGEST_BAUD: Final = 12_000_000
"""Maximum accepted baud rate: the highest rate that the fastest USB adapters support."""
