"""What the tools refuse or cannot do, in words for whoever called them."""

from drivers.errors import DriverError


class CommissioningError(DriverError):
    """The text says what to do."""
