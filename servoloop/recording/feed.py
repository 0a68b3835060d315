"""The live feed of a stack: what a recording has, to whoever looks on, while it happens."""

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
from servoloop.recording.stream import FOLDER, LiveError

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


WAITING: Final = 8
"""So many who want to look on wait until the next cycle takes them in."""


class LiveFeed:
    """A sink that gives each cycle to the programs that are connected to a Unix socket, as a stream of MCAP.

    One that reads too slowly loses whole cycles, which it can count; nobody waits for it.
    """

    def __init__(self, path: Path, messages: Messages, folder: Path | None = None) -> None:
        """``path``: of the socket; ``folder``: the arm's own. Raises LiveError where there cannot be a socket."""
        self._path, self._messages = path, messages
        self._encode = typestore().serialize_cdr
        self._viewers: list[Viewer] = []
        self._cycles = 0
        self._goals: dict[str, Recorded] = {}
        """The newest goal of each controller, and its result behind it, by topic: for those who come later."""
        self._server = socket.socket(socket.AF_UNIX)
        self._server.setblocking(False)
        try:
            new = path.with_suffix(".new")  # under its name only when it listens: one that does not is taken for dead
            new.unlink(missing_ok=True)
            path.with_suffix(FOLDER).unlink(missing_ok=True)
            if folder is not None:
                path.with_suffix(FOLDER).symlink_to(folder)
            self._server.bind(str(new))
            self._server.listen(WAITING)
            new.rename(path)
        except OSError as error:
            self._server.close()
            raise LiveError(f"nobody can look on, {path} cannot be made: {error.strerror or error}") from error

    @property
    def eager(self) -> bool:
        """Whether somebody looks on, who wants each cycle as it comes."""
        return bool(self._viewers)

    def write(self, sample: CycleSample) -> None:
        """Give a cycle to all who look on."""
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
        """Hand over what the sockets take, and forget those who have gone."""
        for viewer in self._viewers:
            viewer.send()
        self._viewers = [viewer for viewer in self._viewers if not viewer.gone]

    def close(self, transfers: Sequence[Transfer], failed: bool) -> None:
        """End. Who looks on is told by the end of the stream."""
        self._path.unlink(missing_ok=True)
        self._path.with_suffix(FOLDER).unlink(missing_ok=True)
        self._server.close()
        self._send(self._viewers, self._messages.of_transfers(transfers))
        for viewer in self._viewers:
            viewer.send()
            viewer.close()

    def _keep_goals(self, messages: Iterable[Recorded]) -> None:
        for one in messages:
            if one.topic.endswith(GOAL):
                self._goals.pop(one.topic.removesuffix(GOAL) + RESULT, None)  # of the goal before
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
        """Encode once, for all who can take it."""
        ready = [viewer for viewer in viewers if viewer.ready]
        if not ready:
            return
        for topic, kind, stamp_ns, message in messages:
            data = bytes(self._encode(message, kind))
            for viewer in ready:
                if not viewer.knows(topic):
                    viewer.add_channel(topic, kind, definition(kind))
                viewer.add_message(topic, stamp_ns, data, self._cycles)
