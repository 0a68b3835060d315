"""A figure of a virtual servo, and the expected value."""

from dataclasses import dataclass
from typing import Final

TOLERANCE: Final = 0.15


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure. ``expected`` is None if no measurement of a real servo is known."""

    name: str
    unit: str
    measured: float
    expected: float | None
    source: str = ""
    reason: str = ""
    """Reason for a difference that exceeds the tolerance."""

    @property
    def ratio(self) -> float | None:
        """Measured over expected."""
        return self.measured / self.expected if self.expected else None

    @property
    def fits(self) -> bool:
        """Whether the figure is within the tolerance, or whether a reason is given for the difference."""
        if self.expected is None or self.reason:
            return True
        return abs(self.measured - self.expected) <= TOLERANCE * abs(self.expected)
