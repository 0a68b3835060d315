"""A running stack as the source of a page: it waits for the stack to come back when it has ended."""

import threading
from typing import Final

from servoloop.live.errors import LiveError
from servoloop.live.folder import find_stack
from servoloop.live.stream import MessageStream, open_live
from servoloop.view.watched import Watched

AGAIN_S: Final = 1.0
"""So long until it looks again for a stack that has ended."""


class LiveSource:
    """The newest state of a running stack; its thread reads the stack's feed."""

    def __init__(self, arm: str | None) -> None:
        """``arm``: its name, None for the only one that runs. Raises LiveError where none runs."""
        self._arm = find_stack(arm).arm
        self._ended = threading.Event()
        self._stream: MessageStream | None = None
        self.watched = Watched()
        self.connected = False
        self._thread = threading.Thread(target=self._read, name="live feed", daemon=True)
        self._thread.start()

    @property
    def status(self) -> str:
        """What the page says of it."""
        if self.connected:
            return f"{self._arm}: live"
        return f"{self._arm}: the stack has ended. Waiting for it to come back"

    def close(self) -> None:
        """End."""
        self._ended.set()
        if self._stream is not None:
            self._stream.close()
        self._thread.join(AGAIN_S)

    def _read(self) -> None:
        while not self._ended.is_set():
            try:
                self._stream = open_live(find_stack(self._arm))
            except LiveError:
                self._ended.wait(AGAIN_S)
                continue
            try:
                self._follow(self._stream)
            finally:
                self.connected = False

    def _follow(self, stream: MessageStream) -> None:
        """Take all that a stack says until it ends."""
        watched = Watched()
        with stream:
            for received in stream:
                watched.take(received)
                if not self.connected and watched.state.snapshot.joints:
                    self.watched, self.connected = watched, True
