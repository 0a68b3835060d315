"""The log of servos' faults: servos to which the same happens in one cycle are one event, and one line."""

import logging
from collections.abc import Sequence
from typing import Final

LOG = logging.getLogger("servoloop.hal")

_PLURAL: Final = {
    "answers": "answer",
    "does": "do",
    "has": "have",
    "is": "are",
    "it": "they",
    "its": "their",
    "refuses": "refuse",
    "was": "were",
}
"""Words that change where several servos are reported."""


class FaultLog:
    """Collects what happens to servos in one cycle, and logs it at the cycle's end."""

    def __init__(self) -> None:
        self.events: dict[tuple[int, str], list[tuple[str, int]]] = {}
        """The servos (label, ID) of each event, by the log's level and what happened; almost always there are none."""

    def note(self, level: int, label: str, servo_id: int, text: str) -> None:
        """Note what happened to one servo.

        Args:
            level: The level of the log line.
            label: The joint's name in a message.
            servo_id: The servo's ID.
            text: What happened. It begins with joint and servo (``elbow: servo 2 ...``), unless it is about all
                servos of a line.
        """
        called = f"{label}: servo {servo_id} "
        servos = self.events.setdefault((level, text.removeprefix(called)), [])
        if text.startswith(called):
            servos.append((label, servo_id))

    def flush(self) -> None:
        """Log one line for each event."""
        for (level, what), servos in self.events.items():
            LOG.log(level, "%s", _sentence(what, servos))
        self.events.clear()


def _sentence(what: str, servos: Sequence[tuple[str, int]]) -> str:
    if not servos:
        return what
    if len(servos) == 1:
        ((label, servo_id),) = servos
        return f"{label}: servo {servo_id} {what}"
    first, _, remedy = what.partition(":")
    plural = " ".join(_PLURAL.get(word, word) for word in first.split(" "))
    named = ", ".join(f"{label} (servo {servo_id})" for label, servo_id in servos)
    return f"{named} {plural}{remedy and ':'}{remedy}"
