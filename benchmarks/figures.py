"""What a figure of a virtual servo is, beside that of the real one."""

from dataclasses import dataclass
from typing import Final

TOLERANCE: Final = 0.15


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure; ``expected`` is missing where nobody has measured it."""

    name: str
    unit: str
    measured: float
    expected: float | None
    source: str = ""
    reason: str = ""
    """Why it may differ by more than the tolerance."""

    @property
    def ratio(self) -> float | None:
        """Measured over expected."""
        return self.measured / self.expected if self.expected else None

    @property
    def fits(self) -> bool:
        """Whether it is as true as it should be, exceptions left out."""
        if self.expected is None or self.reason:
            return True
        return abs(self.measured - self.expected) <= TOLERANCE * abs(self.expected)
