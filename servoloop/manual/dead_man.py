"""The dead-man key: the follower moves only while a key is held."""

from collections.abc import Collection, Sequence
from typing import Final, Protocol

from servoloop.stack.terminal import FIRST_S, HeldKey, typed

QUIT: Final = "q"


class Permission(Protocol):
    """Says whether the follower may move now, and whether all is to end."""

    def allowed(self, now_s: float) -> bool: ...
    def ended(self) -> bool: ...


class Keys(Permission, Protocol):
    """The permission to move, and keys that are commands."""

    def commands(self) -> Sequence[str]:
        """The command keys that were pressed since the last call."""
        ...


class HandsFree:
    """The follower may always move: somebody has asked for that on purpose."""

    def allowed(self, now_s: float) -> bool:
        """Always."""
        return True

    def ended(self) -> bool:
        """Never; a signal ends it."""
        return False

    def commands(self) -> Sequence[str]:
        """None: no key is read."""
        return ()


class DeadMansKey:
    """Any key of the terminal that is held, except q, which ends, and the command keys."""

    def __init__(self, commands: Collection[str] = ()) -> None:
        self._key = HeldKey(FIRST_S)
        self._ended = False
        self._known, self._commands = commands, list[str]()

    def press(self, key: str, now_s: float) -> None:
        """A key was pressed, or repeats."""
        if key == QUIT:
            self._ended = True
            self._key.release()
        elif key in self._known:
            self._commands.append(key)
            self._key.release()
        elif not self._ended:
            self._key.press(key, now_s)

    def allowed(self, now_s: float) -> bool:
        """Whether a key is held, as far as a terminal can tell; never waits."""
        for key in typed(0.0):
            self.press(key, now_s)
        return bool(self._key.held(now_s))

    def ended(self) -> bool:
        """Whether q was pressed."""
        return self._ended

    def commands(self) -> Sequence[str]:
        """The command keys that were pressed since the last call."""
        pressed, self._commands = self._commands, []
        return pressed
