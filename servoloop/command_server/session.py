"""Serve one client of the command socket."""

import logging
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from servoloop.command_server.requests import StackRequests
from servoloop.command_socket import messages
from servoloop.command_socket.errors import CommandError
from servoloop.command_socket.messages import MAX_LINE_BYTES, encode, identity, parse

LOG = logging.getLogger("servoloop")

MAX_UNREAD_BYTES: Final = 1_000_000
"""Maximum number of bytes that wait for a client. A client that reads more slowly is disconnected."""
MESSAGES_PER_S: Final = 2_000.0
"""Maximum rate of messages that are read from one client. Further messages wait in the socket."""
BURST: Final = 200
"""Number of messages that a client may send at once."""
COSTS: Final = {
    messages.SendGoal: 20.0,
    messages.SendGrip: 20.0,
    messages.MoveJoints: 20.0,
    messages.SendSetPoint: 4.0,
}
"""Messages that count as several, because they are planned: 100 goals a second, as over ROS."""
RECEIVED_BYTES: Final = 65_536
LAST_WORDS_S: Final = 0.2
"""Maximum time to send the last bytes to a client that is disconnected, in seconds."""


def peer_user(connection: socket.socket) -> tuple[int, int]:
    """Return the process ID and the user ID of the program at the other end of a Unix socket."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    pid, user, _ = struct.unpack("3i", credentials)
    return pid, user


class Session:
    """Client of the command socket. A thread of its own reads its messages; ``post`` and ``notify`` never wait."""

    def __init__(self, connection: socket.socket, pid: int, requests: StackRequests) -> None:
        self.name = f"process {pid}"
        self.gone = False
        """Whether the client has disconnected and its motions have been ended."""
        self._connection, self._requests = connection, requests
        self._lock = threading.Lock()
        self._unsent = bytearray()
        self._watch_s: float | None = None
        """Minimum time between two states, in seconds. None: the client receives no states."""
        self._shown_s = -float("inf")
        self._thread = threading.Thread(target=self._run, name="commands of a client", daemon=True)

    def start(self) -> None:
        """Begin to read messages."""
        self._thread.start()

    def watch(self, rate_hz: float) -> None:
        """Send states after each cycle, at most ``rate_hz`` times a second. 0 ends the states."""
        self._watch_s = 1.0 / rate_hz if rate_hz > 0.0 else None

    def post(self, message: dict[str, Any]) -> None:
        """Send a message without waiting. Bytes that the socket does not accept are sent after later cycles."""
        with self._lock:
            self._unsent += encode(message)
            self._send()
            if len(self._unsent) > MAX_UNREAD_BYTES:
                LOG.warning("command socket: %s does not read its messages and is disconnected", self.name)
                self._shut()

    def notify(self, state: Callable[[], dict[str, Any]]) -> None:
        """Send results and the state after a cycle. A client that has not read the last state skips this one."""
        for result in self._requests.ended(self):
            self.post(result)
        if self._unsent:
            with self._lock:
                self._send()
        now_s = time.monotonic()
        if self._watch_s is not None and not self._unsent and now_s - self._shown_s >= self._watch_s:
            self._shown_s = now_s
            self.post({"event": "state", **state()})

    def close(self) -> None:
        """Disconnect the client after its last messages. May be called from any thread."""
        deadline_s = time.monotonic() + LAST_WORDS_S
        while self._unsent and time.monotonic() < deadline_s:
            time.sleep(0.01)
            with self._lock:
                self._send()
        self._shut()

    def _run(self) -> None:
        try:
            self._serve()
        except OSError:
            pass  # the client has disconnected
        except Exception:  # a defect here must not keep the motions of the client running
            LOG.exception("command socket: internal error while %s was served", self.name)
        finally:
            self._disconnect()

    def _disconnect(self) -> None:
        """End the motions of the client, whatever happens, and close the connection."""
        try:
            self._requests.disconnect(self)
        except Exception:
            LOG.exception("command socket: internal error at the end of %s", self.name)
        self.close()
        self._connection.close()
        self.gone = True

    def _serve(self) -> None:
        received, rate = bytearray(), _Rate()
        while data := self._connection.recv(RECEIVED_BYTES):
            received += data
            while b"\n" in received:
                line, _, rest = received.partition(b"\n")
                received = rest
                self._answer(bytes(line), rate)
            if len(received) > MAX_LINE_BYTES:
                text = f"the message is larger than {MAX_LINE_BYTES} bytes: send smaller messages"
                self._refuse(None, CommandError("too_large", text))
                return

    def _answer(self, line: bytes, rate: "_Rate") -> None:
        try:
            message = parse(line)
        except CommandError as error:
            rate.wait(1.0)
            self._refuse(identity(line), error)
            return
        rate.wait(COSTS.get(type(message), 1.0))
        try:
            reply = self._requests.answer(self, message)
        except CommandError as error:
            self._refuse(message.id, error)
        except Exception:
            LOG.exception("command socket: internal error in a message of %s", self.name)
            self._refuse(message.id, CommandError("internal", "internal error: the log of the stack has the details"))
        else:
            self.post({"id": message.id, "ok": True, **reply})

    def _refuse(self, number: int | str | None, error: CommandError) -> None:
        self.post({"id": number, "ok": False, "error": error.as_dict()})

    def _send(self) -> None:
        """Send what the socket accepts now. The caller holds the lock."""
        try:
            while self._unsent:
                del self._unsent[: self._connection.send(self._unsent, socket.MSG_DONTWAIT)]
        except BlockingIOError:
            pass
        except OSError:
            self._unsent.clear()  # the thread of the client ends, too

    def _shut(self) -> None:
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)  # ends the thread of the client


class _Rate:
    """Rate of the messages that are read from one client. Messages wait, none is refused."""

    def __init__(self) -> None:
        self._tokens, self._last_s = float(BURST), time.monotonic()

    def wait(self, cost: float) -> None:
        """Wait until a message may be carried out that counts as ``cost`` messages."""
        now_s = time.monotonic()
        self._tokens = min(self._tokens + (now_s - self._last_s) * MESSAGES_PER_S, float(BURST)) - cost
        self._last_s = now_s
        if self._tokens < 0.0:
            time.sleep(-self._tokens / MESSAGES_PER_S)
