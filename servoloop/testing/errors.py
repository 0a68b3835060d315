"""The mistakes of a test on a virtual arm."""

from drivers.errors import DriverError


class ArmTestError(DriverError):
    """A test that asks for what this arm cannot do; the text says how to fix the test."""
