"""Stream the messages of a recording live to other programs."""

import io
import socket
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from servoloop.recording.bus_tap import Transfer
from servoloop.recording.mcap import McapStream
from servoloop.recording.mcap_messages import GOAL, RESULT
from servoloop.recording.message_types import definition, typestore
from servoloop.recording.messages import Messages, Recorded
from servoloop.recording.sampler import CycleSample
from servoloop.recording.stream import FOLDER, NAME, LiveError

MAX_QUEUE_BYTES: Final = 4 * 1024 * 1024
"""Maximum number of bytes queued for a viewer before it misses cycles. This is about 30 s of messages."""


class Viewer:
    """Connection to a program that receives the feed. Sending never blocks.

    ``gone`` becomes True when the program disconnects.
    """

    def __init__(self, connection: socket.socket) -> None:
        self.gone = False
        self._connection = connection
        self._connection.setblocking(False)
        self._waiting = bytearray()
        self._output = io.BytesIO()
        self._mcap = McapStream(self._output, chunked=False)
        self.has_channel, self.add_channel = self._mcap.has_channel, self._mcap.add_channel
        self.add_message = self._mcap.add_message

    @property
    def ready(self) -> bool:
        """Whether the queue has room for more messages."""
        return len(self._waiting) < MAX_QUEUE_BYTES

    def send(self) -> None:
        """Send as many bytes as the socket accepts."""
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
        """Close the connection."""
        self.gone = True
        self._connection.close()


NEW: Final = ".new"
"""Suffix of the socket before it listens."""
WAITING: Final = 8
"""Maximum number of new viewers that can wait for the next cycle."""


class LiveFeed:
    """Sink that sends each cycle as an MCAP stream to all programs connected to a Unix socket.

    A program that reads too slowly misses whole cycles and can count the missed cycles. The stack never waits for a
    viewer.
    """

    complete = False

    def __init__(self, path: Path, messages: Messages, folder: Path | None = None, name: str = "") -> None:
        """Create the socket.

        Args:
            path: Path of the socket.
            messages: Factory of the messages.
            folder: Folder of the arm, if any.
            name: Full name of the stack if the name of the socket does not contain it.

        Raises:
            LiveError: The socket cannot be created.
        """
        self._path, self._messages = path, messages
        self._encode = typestore().serialize_cdr
        self._viewers: list[Viewer] = []
        self._cycles = 0
        self._goals: dict[str, Recorded] = {}
        """Latest goal of each controller and its result, keyed by topic. New viewers receive these messages first."""
        self._server = socket.socket(socket.AF_UNIX)
        self._server.setblocking(False)
        try:
            # The socket is renamed after it starts to listen, because clients delete a socket that does not listen.
            new = path.with_suffix(NEW)
            self._remove_files()
            for suffix, target in ((FOLDER, folder), (NAME, name)):
                if target:
                    path.with_suffix(suffix).symlink_to(target)
            self._server.bind(str(new))
            self._server.listen(WAITING)
            new.rename(path)
        except OSError as error:
            self._server.close()
            with suppress(OSError):
                self._remove_files()
            raise LiveError(f"cannot create the socket {path} of the live feed: {error.strerror or error}") from error

    @property
    def eager(self) -> bool:
        """Whether a viewer is connected. Viewers receive each cycle immediately."""
        return bool(self._viewers)

    def write(self, sample: CycleSample) -> None:
        """Send a cycle to all viewers."""
        self._cycles += 1
        new = self._accept()
        if new:
            self._send(new, [*self._messages.latched(sample.state.stamp_s), *self._goals.values()])
            self._viewers += new
        if sample.goals or self._viewers:
            messages = list(self._messages.of_cycle(sample))
            self._keep_goals(messages)
            self._send(self._viewers, messages)

    def flush(self) -> None:
        """Send as many bytes as the sockets accept, and drop viewers that have disconnected."""
        for viewer in self._viewers:
            viewer.send()
        self._viewers = [viewer for viewer in self._viewers if not viewer.gone]

    def close(self, transfers: Sequence[Transfer], failed: bool) -> None:
        """Send the last transfers and close the feed. Viewers see the end of the stream."""
        self._path.unlink(missing_ok=True)
        self._remove_files()
        self._server.close()
        self._send(self._viewers, self._messages.of_transfers(transfers))
        for viewer in self._viewers:
            viewer.send()
            viewer.close()

    def _remove_files(self) -> None:
        """Remove the links next to the socket, and a socket that was not completed."""
        for suffix in (NEW, FOLDER, NAME):
            self._path.with_suffix(suffix).unlink(missing_ok=True)

    def _keep_goals(self, messages: Iterable[Recorded]) -> None:
        for one in messages:
            if one.topic.endswith(GOAL):
                # The result of the previous goal is no longer current.
                self._goals.pop(one.topic.removesuffix(GOAL) + RESULT, None)
                self._goals[one.topic] = one
            elif one.topic.endswith(RESULT):
                self._goals[one.topic] = one

    def _accept(self) -> list[Viewer]:
        new = []
        with suppress(BlockingIOError):
            while True:
                new.append(Viewer(self._server.accept()[0]))
        return new

    def _send(self, viewers: Sequence[Viewer], messages: Iterable[Recorded]) -> None:
        """Encode each message once and queue it for every viewer with room in its queue."""
        ready = [viewer for viewer in viewers if viewer.ready]
        if not ready:
            return
        for topic, kind, stamp_ns, message in messages:
            data = bytes(self._encode(message, kind))
            for viewer in ready:
                if not viewer.has_channel(topic):
                    viewer.add_channel(topic, kind, definition(kind))
                viewer.add_message(topic, stamp_ns, data, self._cycles)
