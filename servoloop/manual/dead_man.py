"""Dead-man key: the arm moves only while a key is held."""

from collections.abc import Collection, Sequence
from typing import Final, Protocol

from servoloop.stack.terminal import FIRST_S, HeldKey, typed

QUIT: Final = "q"


class Permission(Protocol):
    """Source of the permission to move. The key reports whether the arm may move and whether the command must end."""

    def allowed(self, now_s: float) -> bool: ...
    def ended(self) -> bool: ...


class Keys(Permission, Protocol):
    """Source of the permission to move, with additional command keys."""

    def commands(self) -> Sequence[str]:
        """Return the command keys pressed since the last call."""
        ...


class HandsFree:
    """Unconditional permission to move, for ``--hands-free``. No keys are read."""

    def allowed(self, now_s: float) -> bool:
        """Return True."""
        return True

    def ended(self) -> bool:
        """Return False, because only a signal ends the command."""
        return False

    def commands(self) -> Sequence[str]:
        """Return an empty sequence, because no keys are read."""
        return ()


class DeadMansKey:
    """Permission to move while a key is held in the terminal; command keys and q, which ends the command, do not
    count."""

    def __init__(self, commands: Collection[str] = ()) -> None:
        self._key = HeldKey(FIRST_S)
        self._ended = False
        self._known, self._commands = commands, list[str]()

    def press(self, key: str, now_s: float) -> None:
        """Process a key that was pressed or that repeats."""
        if key == QUIT:
            self._ended = True
            self._key.release()
        elif key in self._known:
            self._commands.append(key)
            self._key.release()
        elif not self._ended:
            self._key.press(key, now_s)

    def allowed(self, now_s: float) -> bool:
        """Return whether a key is held, as far as the terminal can detect this. The call does not block."""
        for key in typed(0.0):
            self.press(key, now_s)
        return bool(self._key.held(now_s))

    def ended(self) -> bool:
        """Return whether q was pressed."""
        return self._ended

    def commands(self) -> Sequence[str]:
        """Return the command keys pressed since the last call."""
        pressed, self._commands = self._commands, []
        return pressed
