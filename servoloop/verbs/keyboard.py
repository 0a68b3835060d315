"""What a person types, waited for in such a way that a signal ends the wait."""

import os
import select
import sys
from collections.abc import Callable
from typing import Final

from servoloop.processes import Interrupted
from servoloop.signals import Signals

LOOK_S: Final = 0.03
CHUNK: Final = 4096


class Keyboard:
    """Reads lines from standard input. Nobody else may read there: several lines can come at once."""

    def __init__(self, signals: Signals, left: str = "") -> None:
        """``left``: what is said of how things are left, behind the reason for an interruption."""
        self.left = left
        self._signals = signals
        self._typed = b""

    def line(self) -> str | None:
        """The next line, if one comes within ``LOOK_S``. Raises Interrupted after a signal, and at the input's end."""
        self._go_on()
        if b"\n" not in self._typed and self._ready():
            more = os.read(sys.stdin.fileno(), CHUNK)
            if not more:
                raise self._ended("the input has ended")
            self._typed += more
        if b"\n" not in self._typed:
            return None
        line, _, self._typed = self._typed.partition(b"\n")
        self._go_on()
        return line.decode(errors="replace")

    def next_line(self, meanwhile: Callable[[], None] = lambda: None) -> str:
        """Wait for a line; ``meanwhile`` is called all the while."""
        while (line := self.line()) is None:
            meanwhile()
        return line

    def agrees(self, question: str) -> bool:
        """Ask a question that y or n answers; anything else is asked again, Enter alone means no."""
        while True:
            print(f"{question} [y/N]: ", end="", file=sys.stderr, flush=True)
            answer = self.next_line().strip().lower()
            if answer in ("", "n", "no"):
                return False
            if answer in ("y", "yes"):
                return True

    def pressed(self) -> bool:
        """Whether somebody pressed a key at a terminal (Enter, where it waits for lines)."""
        return sys.stdin.isatty() and bool(self._typed or select.select([sys.stdin], [], [], 0.0)[0])

    def _ready(self) -> bool:
        return bool(select.select([sys.stdin], [], [], LOOK_S)[0])

    def _go_on(self) -> None:
        if self._signals.count:
            raise self._ended("interrupted")

    def _ended(self, why: str) -> Interrupted:
        return Interrupted(f"{why}: {self.left}" if self.left else why)
