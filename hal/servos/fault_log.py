"""Log servo faults. If several servos have the same fault in one cycle, it is logged as one line."""

import logging
import re
from dataclasses import dataclass, field
from typing import Final

from hal.same_event import as_one, event_of

LOG = logging.getLogger("servoloop.hal")

_PLURAL: Final = {
    "responds": "respond",
    "does": "do",
    "has": "have",
    "holds": "hold",
    "is": "are",
    "it": "they",
    "its": "their",
    "moves": "move",
    "refuses": "refuse",
    "rejects": "reject",
    "reports": "report",
    "was": "were",
}
"""Plural forms of words in a message about several servos."""


class FaultLog:
    """Log that collects the events of one cycle and writes them when the cycle ends."""

    def __init__(self) -> None:
        self.events: dict[tuple[object, ...], _Event] = {}
        """Events of the cycle, keyed by their common text; usually empty."""

    def note(self, level: int, label: str, servo_id: int, text: str) -> None:
        """Record an event of one servo.

        Args:
            level: Level of the log record.
            label: Name of the joint in messages.
            servo_id: ID of the servo.
            text: Description. The text contains the joint and the servo (``elbow: servo 2 ...``), unless it is about
                all servos of a bus. Descriptions that differ only in their numbers are treated as one event.
        """
        lead, called, what = text.partition(f"{label}: servo {servo_id} ")
        key = (level, lead, event_of(what)) if called else (level, text)
        event = self.events.setdefault(key, _Event(level, lead))
        if called:
            event.servos.append((label, servo_id))
            event.texts.append(what)

    def flush(self) -> None:
        """Log one line for each event."""
        for event in self.events.values():
            LOG.log(event.level, "%s", event.sentence())
        self.events.clear()


@dataclass(slots=True)
class _Event:
    """Event that affects some servos or a whole bus."""

    level: int
    lead: str
    """Text that precedes the servo names. For a whole bus, this is the complete text."""
    servos: list[tuple[str, int]] = field(default_factory=list)
    """Joint label and servo ID of each servo."""
    texts: list[str] = field(default_factory=list)
    """Text that follows the name of each servo."""

    def sentence(self) -> str:
        if not self.servos:
            return self.lead
        what = as_one(self.texts)
        if len(self.servos) == 1:
            ((label, servo_id),) = self.servos
            return f"{self.lead}{label}: servo {servo_id} {what}"
        named = ", ".join(f"{label} (servo {servo_id})" for label, servo_id in self.servos)
        first, *rest = re.split("([:,])", what, maxsplit=1)
        plural = " ".join(_PLURAL.get(word, word) for word in first.split(" "))
        return f"{self.lead}{named} {plural}{''.join(rest)}"
