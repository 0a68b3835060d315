"""The log of servos' faults: servos to which the same happens in one cycle are one event, and one line."""

import logging
import re
from dataclasses import dataclass, field
from typing import Final

from hal.same_event import as_one, event_of

LOG = logging.getLogger("servoloop.hal")

_PLURAL: Final = {
    "answers": "answer",
    "does": "do",
    "has": "have",
    "holds": "hold",
    "is": "are",
    "it": "they",
    "its": "their",
    "moves": "move",
    "refuses": "refuse",
    "reports": "report",
    "was": "were",
}
"""Words that change where several servos are reported."""


class FaultLog:
    """Collects what happens to servos in one cycle, and logs it at the cycle's end."""

    def __init__(self) -> None:
        self.events: dict[tuple[object, ...], _Event] = {}
        """The events by what they have in common; almost always there are none."""

    def note(self, level: int, label: str, servo_id: int, text: str) -> None:
        """Note what happened to one servo.

        Args:
            level: The level of the log line.
            label: The joint's name in a message.
            servo_id: The servo's ID.
            text: What happened. It names joint and servo (``elbow: servo 2 ...``), unless it is about all servos of a
                line. Texts that differ in their figures alone are one event.
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
    """What happened to some servos, or to a whole line."""

    level: int
    lead: str
    """The words before the names of the servos; of a line: all words."""
    servos: list[tuple[str, int]] = field(default_factory=list)
    """Label and ID."""
    texts: list[str] = field(default_factory=list)
    """The words after each servo's name."""

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
