"""Connect a session to the socket of its client."""

import logging
import socket
import struct
import threading
import time
from contextlib import suppress
from typing import Final

from servoloop.command_server.requests import StackRequests
from servoloop.command_server.session import Session

LOG = logging.getLogger("servoloop")

RECEIVED_BYTES: Final = 65_536
LAST_WORDS_S: Final = 0.2
"""Maximum time to send the last bytes to a client that is being disconnected, in seconds."""


def peer_user(connection: socket.socket) -> tuple[int, int]:
    """Return the process ID and the user ID of the program at the other end of a Unix socket."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    pid, user, _ = struct.unpack("3i", credentials)
    return pid, user


class SocketConnection:
    """Connected client of the command socket. A separate thread receives bytes and passes them to the session."""

    def __init__(self, connection: socket.socket, pid: int, requests: StackRequests) -> None:
        self.session = Session(f"process {pid}", self, requests)
        self.gone = False
        """Whether the client has disconnected and its motions have been stopped."""
        self._connection = connection
        self._thread = threading.Thread(target=self._run, name="commands of a client", daemon=True)

    def start(self) -> None:
        """Start reading messages."""
        self._thread.start()

    def send(self, data: bytes | bytearray) -> int:
        """Send as many bytes as the socket accepts now, and return their number."""
        try:
            return self._connection.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)  # the client has disconnected, so its thread ends as well

    def shut(self) -> None:
        """Close the connection in both directions, which also ends the client's thread."""
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Disconnect the client after sending its last messages. May be called from any thread."""
        deadline_s = time.monotonic() + LAST_WORDS_S
        while self.session.unsent and time.monotonic() < deadline_s:
            time.sleep(0.01)
            self.session.flush()
        self.shut()

    def _run(self) -> None:
        try:
            self._serve()
        except OSError:
            pass  # the client has disconnected
        except Exception:  # an error here must not let the client's motions continue
            LOG.exception("command socket: internal error while serving %s", self.session.name)
        finally:
            self.session.end()
            self.close()
            self._connection.close()
            self.gone = True

    def _serve(self) -> None:
        while data := self._connection.recv(RECEIVED_BYTES):
            self.session.receive(data)
            while (left_s := self.session.serve()) > 0.0:
                time.sleep(left_s)
            if self.session.refused:
                return
