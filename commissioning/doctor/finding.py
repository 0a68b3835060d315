"""A finding is one thing that is wrong: its symptom in its owner's words, its cause, and the command that mends it."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

Severity = Literal["fault", "warning", "note"]
SEVERITIES: Final[tuple[Severity, ...]] = ("fault", "warning", "note")


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of finding. ``rank`` (0 to 100) says how likely it is the root of the other findings.

    ``explains``: kinds that are its consequences where both are found at one place.
    """

    severity: Severity
    rank: int
    explains: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Place:
    """A place is a whole machine, a bus or a servo: what is not said is None."""

    bus: str | None = None
    joint: str | None = None
    servo_id: int | None = None

    def covers(self, other: "Place") -> bool:
        """Whether the other place is this one or within it."""
        return self.bus in (None, other.bus) and self.servo_id in (None, other.servo_id)

    def __str__(self) -> str:
        servo = "" if self.servo_id is None else f"servo {self.servo_id}"
        named = f"{self.joint} ({servo})" if self.joint else servo
        return f"{named} on bus {self.bus}" if named and self.bus else named or (f"bus {self.bus}" if self.bus else "")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong. ``command`` is None where no command mends it, but the cause's text says what does."""

    id: str
    severity: Severity
    rank: int
    place: Place
    symptom: str
    cause: str
    command: str | None = None


def ranked(findings: Iterable[Finding], kinds: dict[str, Kind]) -> tuple[Finding, ...]:
    """The findings, the likeliest root first, without those that a likelier one explains."""
    ordered = sorted(dict.fromkeys(findings), key=_order)
    return tuple(one for at, one in enumerate(ordered) if not any(_explains(kinds, by, one) for by in ordered[:at]))


def _order(finding: Finding) -> tuple[int, int, tuple[str, ...]]:
    """What nobody cares about decides last, so that the order of the checks does not."""
    place = finding.place
    servo = "" if place.servo_id is None else f"{place.servo_id:03d}"
    texts = (place.bus or "", servo, finding.id, str(place), repr(finding))
    return -finding.rank, SEVERITIES.index(finding.severity), texts


def _explains(kinds: dict[str, Kind], by: Finding, one: Finding) -> bool:
    """Whether the likelier finding explains the other one, so that this needs no words of its own."""
    return by.rank > one.rank and one.id in kinds[by.id].explains and by.place.covers(one.place)
