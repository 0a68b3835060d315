"""Define the typed errors that a stack sends to the clients of its command socket."""

from collections.abc import Mapping
from typing import Any, Final, Literal

from drivers.errors import DriverError

ErrorKind = Literal[
    "malformed",
    "version",
    "too_large",
    "too_many",
    "foreign_user",
    "stale",
    "not_owner",
    "owned",
    "unknown",
    "rejected",
    "failed",
    "timeout",
    "ended",
    "internal",
]
KINDS: Final[Mapping[ErrorKind, str]] = {
    "malformed": "The message is not a JSON object, or a field is missing, unknown or invalid.",
    "version": "The message has another version of this protocol.",
    "too_large": "The message is too large. The stack closes the connection.",
    "too_many": "Too many clients are connected. The stack closes the connection.",
    "foreign_user": "The client belongs to another user. The stack closes the connection.",
    "stale": "The command was sent too long ago. It moves nothing.",
    "not_owner": "The client has not taken the motion, or has lost it.",
    "owned": "Another client has taken the motion.",
    "unknown": "A controller, joint or goal with this name does not exist. The text lists the names that do.",
    "rejected": "The controller rejects the goal or command.",
    "failed": "The hardware, the controller manager or a recording did not carry out the request.",
    "timeout": "The control loop did not carry out the request in time. It may still do so.",
    "ended": "The stack has ended, or the connection is closed.",
    "internal": "The stack has a defect. Its log contains the details.",
}
"""Meaning of each kind of error."""


class CommandError(DriverError):
    """A stack has refused a message. ``kind`` is its type, the text names the cause and the remedy."""

    def __init__(self, kind: ErrorKind, text: str) -> None:
        super().__init__(text)
        self.kind: ErrorKind = kind

    def as_dict(self) -> dict[str, Any]:
        """Return the error as part of a reply."""
        return {"type": self.kind, "text": str(self)}
