"""Measured value of a virtual servo, with the expected value."""

from dataclasses import dataclass
from typing import Final

TOLERANCE: Final = 0.15


@dataclass(frozen=True, slots=True)
class Figure:
    """Measured value. ``expected`` is None if no measurement of a real servo is known."""

    name: str
    unit: str
    measured: float
    expected: float | None
    source: str = ""
    reason: str = ""
    """Reason why a difference exceeds the tolerance."""

    @property
    def ratio(self) -> float | None:
        """Measured value divided by the expected value."""
        return self.measured / self.expected if self.expected else None

    @property
    def fits(self) -> bool:
        """Whether the value is within the tolerance or the difference has a documented reason."""
        if self.expected is None or self.reason:
            return True
        return abs(self.measured - self.expected) <= TOLERANCE * abs(self.expected)
