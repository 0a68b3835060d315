"""Counts at the seams: the wrap at 0/4095, turns, the homing offset, a range that crosses the seam.

Pure functions. A servo with a magnetic encoder reads ``(actual - offset) mod turn`` in single-turn
feedback. The offset is a sign-magnitude number of eleven bits, so it reaches from -2047 to 2047: one
count less than half a turn, and a sum or difference of counts must be brought back into a turn before
it becomes an offset ("Magnitude 2114 exceeds 2047" is what forgetting that looks like).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

TURN: Final = 4096
LARGEST_OFFSET: Final = 2047


def shortest(start: int, end: int, turn: int = TURN) -> int:
    """The shorter way from one reading to another, counts, ``-turn/2`` up to but not ``turn/2``."""
    return (end - start + turn // 2) % turn - turn // 2


def unwrap(before: int, reading: int, turn: int = TURN) -> int:
    """The continuous count that says ``reading`` and is nearest to the continuous count ``before``.

    True as long as the shaft moves less than half a turn between two readings.
    """
    return before + shortest(before, reading, turn)


def unwrapped(readings: Iterable[int], turn: int = TURN) -> list[int]:
    """A stream of readings as one continuous count, beginning with the first reading as it is."""
    counts: list[int] = []
    for reading in readings:
        counts.append(unwrap(counts[-1], reading, turn) if counts else reading)
    return counts


def reading_of(actual: int, offset: int, turn: int = TURN) -> int:
    """What the servo says with its encoder at ``actual``."""
    return (actual - offset) % turn


def actual_of(reading: int, offset: int, turn: int = TURN) -> int:
    """Where the encoder is, 0 to ``turn - 1``, when the servo says ``reading`` (of any number of turns)."""
    return (reading + offset) % turn


def offset_for(actual: int, wanted: int, turn: int = TURN) -> int:
    """The offset with which an encoder at ``actual`` says ``wanted``; always one that the register can hold.

    Exactly half a turn is out of reach by one count: then the servo says ``wanted - 1``.
    """
    half = turn // 2
    return max(shortest(wanted, actual, turn), 1 - half)


def new_offset(reading: int, offset: int, wanted: int, turn: int = TURN) -> int:
    """The offset to write so that a servo that says ``reading`` with ``offset`` says ``wanted`` instead."""
    return offset_for(actual_of(reading, offset, turn), wanted, turn)


@dataclass(frozen=True, slots=True)
class Travel:
    """A swept range in continuous counts: ``upper`` may lie beyond the turn that ``lower`` is in."""

    lower: int
    upper: int

    @property
    def span(self) -> int:
        """Counts from end to end."""
        return self.upper - self.lower


def travel_of(readings: Iterable[int], turn: int = TURN) -> Travel:
    """The range that a sweep covered, right also where it crosses the seam; ValueError without readings."""
    counts = unwrapped(readings, turn)
    if not counts:
        raise ValueError("a sweep needs at least one reading")
    return Travel(min(counts), max(counts))


def offset_for_travel(travel: Travel, offset: int, turn: int = TURN) -> int:
    """The offset that puts the travel's middle at half a turn and so the seam outside the travel.

    ``travel`` was read with ``offset``. ValueError if the travel leaves no room for the seam.
    """
    # A count to spare: the offset may be out of reach by one.
    if travel.span > turn - 2:
        raise ValueError(f"the travel of {travel.span} counts fills the turn of {turn}: it cannot be kept off the seam")
    return new_offset((travel.lower + travel.upper) // 2, offset, turn // 2, turn)


def moved(travel: Travel, old: int, new: int, turn: int = TURN) -> Travel:
    """The same travel as it reads with the offset ``new`` instead of ``old``."""
    lower = reading_of(actual_of(travel.lower, old, turn), new, turn)
    return Travel(lower, lower + travel.span)
