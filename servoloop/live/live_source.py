"""A running stack as a source: it waits for the stack to come back when it has ended."""

import threading
from typing import Final

from drivers.clock import Clock
from servoloop.live.errors import LiveError
from servoloop.live.folder import RunningStack, find_stack, running_stacks
from servoloop.live.stream import MessageStream, open_live
from servoloop.live.watched import Watched

AGAIN_S: Final = 1.0
"""So long until it looks again for a stack that has ended."""

SILENT_S: Final = 2.0
"""A stack that has given no cycle for so long is not called live."""


class LiveSource:
    """The newest state of a running stack; its thread reads the stack's feed."""

    def __init__(self, arm: str | None, clock: Clock) -> None:
        """``arm``: its name or folder, None for the only one that runs. Raises LiveError where none runs."""
        self._clock, self._heard_s = clock, clock.now()
        self._found = found = find_stack(arm)
        self.arm, self.folder = found.arm, found.folder
        self._ended = threading.Event()
        self._stream: MessageStream | None = None
        self.watched = Watched()
        self.connected = False
        self._thread = threading.Thread(target=self._read, name="live feed", daemon=True)
        self._thread.start()

    @property
    def status(self) -> str:
        """Whether the stack runs, and whether it gives cycles."""
        if not self.connected:
            return f"{self.arm}: the stack has ended. Waiting for it to come back"
        if not self.well:
            return f"{self.arm}: no cycle for {self.silent_s:.0f} s. The stack is paused, or it hangs"
        return f"{self.arm}: live"

    @property
    def well(self) -> bool:
        """Whether cycles come."""
        return self.connected and self.silent_s <= SILENT_S

    @property
    def silent_s(self) -> float:
        """So long ago the stack has given a cycle."""
        return self._clock.now() - self._heard_s

    @property
    def _same_arm(self) -> str:
        """What finds this arm again: its folder, because another arm's may have the same name."""
        return self.arm if self.folder is None else str(self.folder)

    def close(self) -> None:
        """End."""
        self._ended.set()
        if self._stream is not None:
            self._stream.close()
        self._thread.join(AGAIN_S)

    def _read(self) -> None:
        while not self._ended.is_set():
            try:
                self._stream = open_live(self._stack())
            except LiveError:
                self._ended.wait(AGAIN_S)
                continue
            try:
                self._follow(self._stream)
            finally:
                self.connected = False

    def _stack(self) -> RunningStack:
        """The stack of the beginning as long as it runs, then another one of its arm. Raises LiveError."""
        if self._found not in running_stacks():
            self._found = find_stack(self._same_arm)
        return self._found

    def _follow(self, stream: MessageStream) -> None:
        """Take all that a stack says until it ends."""
        watched = Watched()
        with stream:
            for received in stream:
                watched.take(received)
                self._heard_s = self._clock.now()
                if not self.connected and watched.state.snapshot.joints:
                    self.watched, self.connected = watched, True
