"""What is wrong with a list of faults."""

from drivers.errors import DriverError


class FaultError(DriverError):
    """The faults cannot be done, or not be read. The text lists all of them and says what to do."""
