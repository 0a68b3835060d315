"""One program that looks on at a stack: its socket, and what it has not taken yet."""

import io
import socket
from typing import Final

from servoloop.recorder.mcap_stream import McapStream

BEHIND: Final = 4 * 1024 * 1024
"""Bytes that wait for a program until it loses cycles: half a minute."""


class Viewer:
    """The stack's end of a connection. It never waits; ``gone`` when the other end is."""

    def __init__(self, connection: socket.socket) -> None:
        self.gone = False
        self._connection = connection
        self._connection.setblocking(False)
        self._waiting = bytearray()
        self._output = io.BytesIO()
        self._mcap = McapStream(self._output, chunked=False)
        self.knows, self.add_channel = self._mcap.knows, self._mcap.add_channel
        self.add_message = self._mcap.add_message

    @property
    def ready(self) -> bool:
        """Whether it has taken enough to be given more."""
        return len(self._waiting) < BEHIND

    def send(self) -> None:
        """Hand over as much as the socket takes."""
        self._waiting += self._output.getvalue()
        self._output.seek(0)
        self._output.truncate()
        try:
            while self._waiting:
                del self._waiting[: self._connection.send(self._waiting)]
        except BlockingIOError:
            pass
        except OSError:
            self.close()

    def close(self) -> None:
        """End the connection."""
        self.gone = True
        self._connection.close()
