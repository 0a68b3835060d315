"""The dead-man key: the follower moves only while a key is held. Terminals tell presses, and no releases."""

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, Protocol

FIRST_S: Final = 0.7
"""A key that is held repeats after so long at first: half a second in most terminals."""
REPEAT_S: Final = 0.25
"""And then many times in this; the arm holds so long after the key is let go."""
QUIT: Final = "q"


class Permission(Protocol):
    """Says whether the follower may move now, and whether all is to end."""

    def allowed(self, now_s: float) -> bool: ...
    def ended(self) -> bool: ...


class HandsFree:
    """The follower may always move: somebody has asked for that on purpose."""

    def allowed(self, now_s: float) -> bool:
        """Always."""
        return True

    def ended(self) -> bool:
        """Never; a signal ends it."""
        return False


class DeadMansKey:
    """A key that is held: any but q, which ends. Fed with what was typed, so that it needs no terminal itself."""

    def __init__(self) -> None:
        self._until_s = -1.0
        self._ended = False

    def typed(self, keys: str, now_s: float) -> None:
        """Take what was typed since the last time."""
        if QUIT in keys:
            self._ended = True
        elif keys:
            repeats = now_s <= self._until_s
            self._until_s = now_s + (REPEAT_S if repeats else FIRST_S)

    def allowed(self, now_s: float) -> bool:
        """Whether the key is held, as far as a terminal can tell."""
        return not self._ended and now_s <= self._until_s

    def ended(self) -> bool:
        """Whether q was pressed."""
        return self._ended


class TerminalKey(DeadMansKey):
    """The dead-man key of the terminal on stdin. A terminal that is gone has no key that is held, and ends."""

    def allowed(self, now_s: float) -> bool:
        """Whether the key is held; never waits."""
        self.typed(self._waiting(), now_s)
        return super().allowed(now_s)

    def _waiting(self) -> str:
        descriptor = sys.stdin.fileno()
        if not select.select([descriptor], [], [], 0.0)[0]:
            return ""
        try:
            return os.read(descriptor, 1024).decode(errors="replace") or QUIT
        except OSError:
            return QUIT


@contextmanager
def terminal_key() -> Iterator[TerminalKey]:
    """The terminal gives each key as it is pressed, without showing it; at the end all is as it was."""
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield TerminalKey()
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
