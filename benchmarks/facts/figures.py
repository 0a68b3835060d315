"""A figure of a virtual servo and its expected value."""

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
    """Reason for a difference above the tolerance."""

    @property
    def ratio(self) -> float | None:
        """Measured over expected."""
        return self.measured / self.expected if self.expected else None

    @property
    def fits(self) -> bool:
        """Whether the figure is within the tolerance, or has a reason not to be."""
        if self.expected is None or self.reason:
            return True
        return abs(self.measured - self.expected) <= TOLERANCE * abs(self.expected)
