"""Define the typed errors that a stack sends to the clients of its command socket."""

from collections.abc import Mapping
from typing import Any, Final, Literal

from drivers.driver_errors import DriverError

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
    "input",
    "busy",
    "motion_failed",
    "motion_canceled",
    "stream_ended",
    "timeout",
    "ended",
    "internal",
]
KINDS: Final[Mapping[ErrorKind, str]] = {
    "malformed": "The message is not a JSON object, or a field is missing, unknown or invalid.",
    "version": "The message uses a different version of this protocol.",
    "too_large": "The message is too large. The stack closes the connection.",
    "too_many": "Too many clients are connected. The stack closes the connection.",
    "foreign_user": "The client belongs to another user. The stack closes the connection.",
    "stale": "The command was sent too long ago and is ignored.",
    "not_owner": "The client does not have control of the arm, or has lost it.",
    "owned": "Another client has control of the arm.",
    "unknown": "A controller, joint or goal with this name does not exist. The text lists the existing names.",
    "rejected": "The controller rejects the goal or command.",
    "failed": "The hardware, the controller manager or a recording did not carry out the request.",
    "input": "A target of the arm is invalid. Nothing has moved.",
    "busy": "The arm cannot be moved now, for example because its torque is off.",
    "motion_failed": "A motion stopped before it reached its target.",
    "motion_canceled": "A motion was canceled, or another motion has replaced it.",
    "stream_ended": "No stream is open, or the last target arrived too long ago.",
    "timeout": "The control loop did not carry out the request in time, and may still carry it out later.",
    "ended": "The stack has ended, or the connection is closed.",
    "internal": "The stack has a defect. Its log contains the details.",
}
"""Meaning of each error type."""


class CommandError(DriverError):
    """Error for a message that a stack has rejected.

    ``kind`` is the type of the error; the text states the cause and the remedy.
    """

    def __init__(self, kind: ErrorKind, text: str, joint: str = "") -> None:
        """``joint`` is the affected joint, or an empty string if the error does not concern a single joint."""
        super().__init__(text)
        self.kind: ErrorKind = kind
        self.joint = joint

    def as_dict(self) -> dict[str, Any]:
        """Return the error as part of a reply."""
        joint = {"joint": self.joint} if self.joint else {}
        return {"type": self.kind, "text": str(self), **joint}

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> "CommandError":
        """Create the error from the fields of a stack's reply."""
        kind: ErrorKind = next((kind for kind in KINDS if kind == fields.get("type")), "internal")
        return cls(kind, str(fields.get("text", "")), str(fields.get("joint", "")))
