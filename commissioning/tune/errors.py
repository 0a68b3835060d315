"""The error of tuning."""

from commissioning.errors import CommissioningError


class TuneError(CommissioningError):
    """A joint cannot be measured, or a gain cannot be what somebody wants."""
