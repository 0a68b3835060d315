"""Send messages to a running stack over its command socket."""

import os
import socket
import threading
from collections import deque
from time import monotonic
from typing import Any, Final, Self

from pydantic_core import from_json

from servoloop.command_socket.command_errors import CommandError
from servoloop.command_socket.messages import encode
from servoloop.recording.stream import RunningStack, find_stack

TIMEOUT_S: Final = 5.0
"""Default maximum time to wait for a reply, in seconds."""
CONNECT_S: Final = 2.0
"""Maximum time to wait for a connection, in seconds."""
KEPT_EVENTS: Final = 1000
"""Maximum number of events that wait until the program reads them. Older events are dropped."""
COMMANDS: Final = ("goal", "grip", "set_point", "move", "targets")
"""Messages that carry the time at which they were sent."""


class CommandClient:
    """Connection to the command socket of a stack. Any thread may call each method.

    If a method fails, it raises CommandError. The error type is the one that the stack has sent, ``timeout`` if the
    stack does not reply in time, or ``ended`` if the connection is lost.
    """

    def __init__(self, stack: RunningStack, name: str = "") -> None:
        """Connect to a running stack. ``name`` appears in messages to other clients."""
        self.stack = stack
        self._lock = threading.Lock()
        self._events: deque[dict[str, Any]] = deque(maxlen=KEPT_EVENTS)
        self._received = bytearray()
        self._number = 0
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(CONNECT_S)
        try:
            self._socket.connect(str(stack.commands))
        except FileNotFoundError as error:
            self._socket.close()
            text = f"{stack.label} has no command socket: the stack has ended, or was not started with `servoloop up`"
            raise CommandError("ended", text) from error
        except OSError as error:
            self._socket.close()
            text = f"the command socket {stack.commands} cannot be opened: {error.strerror or error}"
            raise CommandError("ended", text) from error
        try:
            self.arm = self.request("hello", client=f"{name or 'a program'} (process {os.getpid()})")
            """Description of the arm, as returned by ``hello``."""
        except CommandError:
            self.close()
            raise

    @classmethod
    def find(cls, arm: str | None = None, name: str = "", namespace: str | None = None) -> Self:
        """Connect to the only running stack, or to the stack of a given arm (name, folder or process ID) or namespace.

        Raises:
            LiveError: No stack of this arm is running, or several are running.
            CommandError: The stack rejects the connection.
        """
        return cls(find_stack(arm, namespace), name)

    def request(self, op: str, timeout_s: float = TIMEOUT_S, **fields: Any) -> dict[str, Any]:
        """Send a message and return the reply.

        Args:
            op: Name of the message.
            timeout_s: Maximum time to wait for the reply, in seconds.
            **fields: Other fields of the message.
        """
        with self._lock:
            self._number += 1
            sent = {"sent_s": monotonic()} if op in COMMANDS else {}
            self._send(encode({"id": self._number, "op": op, **sent, **fields}), timeout_s)
            return self._reply(self._number, monotonic() + timeout_s)

    def events(self, wait_s: float = 0.0) -> list[dict[str, Any]]:
        """Return the events that have arrived since the last call.

        Wait at most ``wait_s`` seconds for the first event.
        """
        with self._lock:
            deadline_s = monotonic() + wait_s
            while (message := self._next(0.0 if self._events else deadline_s - monotonic())) is not None:
                self._keep(message)
            events, self._events = list(self._events), deque(maxlen=KEPT_EVENTS)
        return events

    def close(self) -> None:
        """Close the connection. Motions of this client stop within their limits."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, line: bytes, timeout_s: float) -> None:
        try:
            self._socket.settimeout(timeout_s)  # This also fails if the socket is closed.
            self._socket.sendall(line)
        except TimeoutError:
            self.close()  # part of the message may already have been sent
            raise CommandError(
                "timeout", f"the stack has not read any data for {timeout_s:g} s: check its log"
            ) from None
        except OSError as error:
            if (message := self._refusal()) is not None:
                raise CommandError.of(message.get("error") or {}) from error
            raise self._ended() from error

    def _refusal(self) -> dict[str, Any] | None:
        """Return the error that the stack sent before it closed the connection, or None if it did not send one."""
        try:
            message = self._next(0.0)
        except CommandError:
            return None
        return message if message is not None and _is_refusal(message) else None

    def _reply(self, number: int, deadline_s: float) -> dict[str, Any]:
        while (message := self._next(deadline_s - monotonic())) is not None:
            if _is_refusal(message) and message.get("id") in (number, None):
                raise CommandError.of(message.get("error") or {})
            if message.get("id") == number:
                return message
            self._keep(message)
        raise CommandError("timeout", "the stack does not reply: check its log")

    def _keep(self, message: dict[str, Any]) -> None:
        if "event" in message:
            self._events.append(message)

    def _next(self, wait_s: float) -> dict[str, Any] | None:
        """Return the next message from the stack, or None if no message is complete within ``wait_s`` seconds."""
        deadline_s = monotonic() + wait_s
        while b"\n" not in self._received:
            try:
                self._socket.settimeout(max(deadline_s - monotonic(), 0.0))
                data = self._socket.recv(65536)
            except (TimeoutError, BlockingIOError):
                return None
            except OSError as error:
                raise self._ended() from error
            if not data:
                raise self._ended()
            self._received += data
        line, _, rest = self._received.partition(b"\n")
        self._received = rest
        found = from_json(bytes(line))
        return found if isinstance(found, dict) else {}

    def _ended(self) -> CommandError:
        return CommandError("ended", f"the connection to the stack of {self.stack.name} has ended: restart the stack")


def _is_refusal(message: dict[str, Any]) -> bool:
    """Return whether a message rejects a request. The result of a failed goal is an event with ``ok: false``."""
    return message.get("ok") is False and "event" not in message
