"""Calculate positions, homing offsets and ranges across the wrap from 4095 to 0 counts.

In position mode, a servo with a magnetic encoder reports ``(actual - offset) mod turn``. The offset is an eleven-bit
sign-magnitude number from -2047 to 2047, which is one count less than half a turn. Reduce sums and differences of
counts to one turn before using them as an offset. Otherwise, the write fails with an error such as "Magnitude 2114
exceeds 2047".
"""

from dataclasses import dataclass
from typing import Final

TURN: Final = 4096
LARGEST_OFFSET: Final = 2047


def shortest(start: int, end: int, turn: int = TURN) -> int:
    """Return the shortest signed distance between two readings, in counts, in the range [-turn/2, turn/2)."""
    return (end - start + turn // 2) % turn - turn // 2


def unwrap(before: int, reading: int, turn: int = TURN) -> int:
    """Return the continuous count for ``reading`` that is closest to the continuous count ``before``.

    The result is correct if the shaft moves less than half a turn between the readings.
    """
    return before + shortest(before, reading, turn)


def reading_of(actual: int, offset: int, turn: int = TURN) -> int:
    """Return the position that the servo reports when its encoder is at ``actual``."""
    return (actual - offset) % turn


def actual_of(reading: int, offset: int, turn: int = TURN) -> int:
    """Return the encoder position, from 0 to ``turn - 1``, at which the servo reports ``reading`` (of any turn)."""
    return (reading + offset) % turn


def offset_for(actual: int, wanted: int, turn: int = TURN) -> int:
    """Return the offset that makes the servo report ``wanted`` when its encoder is at ``actual``.

    The offset always fits the register. An offset of half a turn would not fit. In this case, the offset is one count
    smaller in magnitude, and the servo reports ``wanted - 1``.
    """
    half = turn // 2
    return max(shortest(wanted, actual, turn), 1 - half)


def new_offset(reading: int, offset: int, wanted: int, turn: int = TURN) -> int:
    """Return the offset that makes a servo report ``wanted``, given that it reports ``reading`` with ``offset``."""
    return offset_for(actual_of(reading, offset, turn), wanted, turn)


@dataclass(frozen=True, slots=True)
class Travel:
    """A range of motion in continuous counts, which may extend beyond a turn boundary."""

    lower: int
    upper: int

    @property
    def span(self) -> int:
        """Length of the range, in counts."""
        return self.upper - self.lower


def offset_for_travel(travel: Travel, offset: int, turn: int = TURN) -> int:
    """Return the offset that puts the middle of the travel at half a turn, so that the wrap is outside the travel.

    ``travel`` was measured with ``offset``. Raises ValueError if the travel is too long.
    """
    # One count must remain free, because the exact offset may not fit the register.
    if travel.span > turn - 2:
        raise ValueError(
            f"the travel of {travel.span} counts is too long: the wrap must be outside it, and one turn has only "
            f"{turn} counts"
        )
    return new_offset((travel.lower + travel.upper) // 2, offset, turn // 2, turn)


def moved(travel: Travel, old: int, new: int, turn: int = TURN) -> Travel:
    """Convert a travel measured with the offset ``old`` to the offset ``new``."""
    lower = reading_of(actual_of(travel.lower, old, turn), new, turn)
    return Travel(lower, lower + travel.span)
