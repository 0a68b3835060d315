"""Session of one client of the command socket, which receives bytes, handles messages and sends replies.

A session has neither a thread nor a socket, and it reads the time only from its server's clock. A program with sockets
passes bytes to the session from a thread (servoloop/command_server/connection.py). A simulation passes bytes to the
session between two cycles.
"""

import logging
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, Protocol

from servoloop.api.arm_errors import ArmError
from servoloop.command_server.requests import StackRequests
from servoloop.command_socket import messages
from servoloop.command_socket.command_errors import CommandError
from servoloop.command_socket.messages import MAX_LINE_BYTES, encode, identity, parse

LOG = logging.getLogger("servoloop")

MAX_UNREAD_BYTES: Final = 1_000_000
"""Maximum number of bytes waiting to be sent to a client. A client that reads too slowly is disconnected."""
MESSAGES_PER_S: Final = 2_000.0
"""Maximum rate at which messages of one client are handled. Further messages wait."""
BURST: Final = 200
"""Number of messages that a client may send in one burst."""
COSTS: Final[Mapping[type, float]] = {
    messages.SendGoal: 20.0,
    messages.SendGrip: 20.0,
    messages.MoveJoints: 20.0,
    messages.SendSetPoint: 4.0,
}
"""Messages that count as more than one message, because each requires planning a trajectory.

These weights allow 100 goals per second, as over ROS.
"""


class Transport(Protocol):
    """Byte stream to one client."""

    def send(self, data: bytes | bytearray) -> int:
        """Send as many bytes as the client accepts now, without waiting, and return their number."""
        ...

    def shut(self) -> None:
        """Close the stream in both directions."""
        ...


@dataclass(frozen=True, slots=True)
class _Received:
    """Message that a client has sent, or the reason why it is invalid."""

    line: bytes
    message: messages.Message | CommandError
    due_s: float
    """Earliest time at which the message may be handled, in seconds."""


class Session:
    """State of one client. One thread calls ``receive``, ``serve`` and ``end``; ``post`` and ``notify`` never block."""

    def __init__(self, name: str, transport: Transport, requests: StackRequests) -> None:
        """Begin a session.

        Args:
            name: Name of the client in messages, until the client sends its own.
            transport: Byte stream to the client.
            requests: Handlers of the messages.
        """
        self.name = name
        self.refused = False
        """Whether the client has sent a message that is too large, so that its connection must be closed."""
        self._transport, self._requests = transport, requests
        self._lock = threading.Lock()
        self._received, self._unsent = bytearray(), bytearray()
        self._next: _Received | None = None
        self._rate = _Rate(requests.time.now)
        self._watch_s: float | None = None
        """Minimum time between two states, in seconds, or None if the client does not receive states."""
        self._shown_s = -float("inf")

    @property
    def unsent(self) -> bool:
        """Whether bytes are waiting to be sent to the client."""
        return bool(self._unsent)

    def receive(self, data: bytes) -> None:
        """Add bytes from the client. The bytes may end in the middle of a message.

        ``serve`` handles the complete messages.
        """
        self._received += data

    def serve(self) -> float:
        """Handle the received messages as far as the rate limit allows.

        Returns:
            Time until the next received message may be handled, in seconds, or 0 if no message is waiting.
        """
        while not self.refused and (waiting := self._take()) is not None:
            left_s = waiting.due_s - self._requests.time.now()
            if left_s > 0.0:
                return left_s
            self._next = None
            self._answer(waiting)
        return 0.0

    def watch(self, rate_hz: float) -> None:
        """Send states after each cycle, at most ``rate_hz`` times a second. If the rate is 0, states are no longer
        sent."""
        self._watch_s = 1.0 / rate_hz if rate_hz > 0.0 else None

    def post(self, message: dict[str, Any]) -> None:
        """Send a message without waiting. Bytes that the client does not accept are sent after later cycles."""
        with self._lock:
            self._unsent += encode(message)
            self._send()
            if len(self._unsent) > MAX_UNREAD_BYTES:
                LOG.warning("command socket: %s does not read its messages and is disconnected", self.name)
                self._transport.shut()

    def flush(self) -> None:
        """Send as many of the bytes waiting for the client as it accepts."""
        with self._lock:
            self._send()

    def notify(self, state: Callable[[], dict[str, Any]]) -> None:
        """Send results and the state after a cycle.

        A client that has not read the previous state does not receive the new one.
        """
        for result in self._requests.ended(self):
            self.post(result)
        if self._unsent:
            self.flush()
        now_s = self._requests.time.now()
        if self._watch_s is not None and not self._unsent and now_s - self._shown_s >= self._watch_s:
            with suppress(ArmError):  # The stack has no state before its first cycle.
                self.post({"event": "state", **state()})
                self._shown_s = now_s

    def end(self) -> None:
        """Stop the motions of the client within their limits, even after an error."""
        try:
            self._requests.disconnect(self)
        except Exception:
            LOG.exception("command socket: internal error while disconnecting %s", self.name)

    def _take(self) -> _Received | None:
        """Return the next complete message, or None. A message that must wait is returned again by the next call."""
        if self._next is None and b"\n" in self._received:
            line, _, self._received = self._received.partition(b"\n")
            self._next = self._parsed(bytes(line))
        elif self._next is None and len(self._received) > MAX_LINE_BYTES:
            self.refused = True
            text = f"the message is larger than {MAX_LINE_BYTES} bytes: send smaller messages"
            self._refuse(None, CommandError("too_large", text))
        return self._next

    def _parsed(self, line: bytes) -> _Received:
        message = _message_or_error(line)
        return _Received(line, message, self._rate.due_s(COSTS.get(type(message), 1.0)))

    def _answer(self, received: _Received) -> None:
        message = received.message
        if isinstance(message, CommandError):
            self._refuse(identity(received.line), message)
            return
        try:
            reply = self._requests.answer(self, message)
        except CommandError as error:
            self._refuse(message.id, error)
        except Exception:
            LOG.exception("command socket: internal error while handling a message from %s", self.name)
            self._refuse(message.id, CommandError("internal", "internal error: the log of the stack has the details"))
        else:
            self.post({"id": message.id, "ok": True, **reply})

    def _refuse(self, number: int | str | None, error: CommandError) -> None:
        self.post({"id": number, "ok": False, "error": error.as_dict()})

    def _send(self) -> None:
        """Send as many bytes as the client accepts now. The caller holds the lock."""
        while self._unsent and (count := self._transport.send(self._unsent)):
            del self._unsent[:count]


def _message_or_error(line: bytes) -> messages.Message | CommandError:
    """Parse a message. The returned error is a new one: the traceback of the caught error refers to the caller's frame,
    which refers to the returned value."""
    try:
        return parse(line)
    except CommandError as error:
        return CommandError(error.kind, str(error))


class _Rate:
    """Rate limit for the messages of one client. Messages that exceed the rate are delayed instead of rejected."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._tokens, self._last_s = float(BURST), now()

    def due_s(self, cost: float) -> float:
        """Return the time at which a message that counts as ``cost`` messages may be handled, in seconds."""
        now_s = self._now()
        self._tokens = min(self._tokens + (now_s - self._last_s) * MESSAGES_PER_S, float(BURST)) - cost
        self._last_s = now_s
        return now_s - min(self._tokens, 0.0) / MESSAGES_PER_S
