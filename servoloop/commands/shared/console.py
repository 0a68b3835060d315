"""Input and output of commands at a terminal: JSON, tables, confirmations and keyboard input."""

import json
import os
import select
import sys
import termios
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from drivers.driver_errors import DriverError
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals
from servoloop.stack.terminal import raw_keys

if TYPE_CHECKING:
    from rich.console import Console


JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")]


def text_console(stderr: bool = False, highlight: bool = True) -> "Console":
    """Return a console that prints every text as it is.

    The texts of files, devices and users may contain square brackets or colons, which rich would otherwise interpret as
    markup or emoji. Use ``rich.text.Text`` for styles.
    """
    from rich.console import Console

    return Console(stderr=stderr, highlight=highlight, markup=False, emoji=False)


def print_json(value: Any) -> None:
    """Print a dataclass, or a list or mapping of dataclasses, as JSON."""
    typer.echo(json.dumps(value, default=_plain, indent=2))


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def confirm(question: str, yes: bool) -> None:
    """Ask for confirmation unless ``yes`` is set. If the user declines, the command ends with exit status 1."""
    if yes:
        return
    try:
        typer.confirm(question, abort=True, err=True)
    except typer.Abort as error:
        if isinstance(error.__context__, EOFError):
            message = "the question was not answered, and nothing was done; run this command in a terminal"
            raise DriverError(message) from None
        raise


POLL_S: Final = 0.03
"""Maximum time to wait for input in one call, in seconds."""
CHUNK: Final = 4096


class Keyboard:
    """Reader of lines and keys from standard input. Nothing else in the process may read from standard input."""

    def __init__(self, signals: Signals, left: str = "") -> None:
        """Read from standard input; ``left`` describes the state that an interruption leaves, for the error message."""
        self.left = left
        self._signals = signals
        self._typed = b""
        self._raw = ExitStack()
        self._gives_keys = False

    def line(self) -> str | None:
        """Return the next line, or None if no line arrives within ``POLL_S``.

        Raises Interrupted after a signal and at the end of the input.
        """
        self._go_on()
        self.whole_lines()
        if b"\n" not in self._typed and self._ready():
            more = self._read()
            if not more:
                raise self._ended("the input has ended")
            self._typed += more
        if b"\n" not in self._typed:
            return None
        line, _, self._typed = self._typed.partition(b"\n")
        self._go_on()
        return line.decode(errors="replace")

    def next_line(self, meanwhile: Callable[[], None] = lambda: None) -> str:
        """Wait for a line, and call ``meanwhile`` repeatedly while waiting."""
        while (line := self.line()) is None:
            meanwhile()
        return line

    def agrees(self, question: str, enter_is_no: bool = True) -> bool:
        """Ask a yes-or-no question and repeat it until the answer is valid.

        Pressing Enter alone means no, unless ``enter_is_no`` is False. Keys that were typed before the question are
        discarded.
        """
        while True:
            self._forget()
            print(f"{question} [{'y/N' if enter_is_no else 'y/n'}]: ", end="", file=sys.stderr, flush=True)
            answer = self.next_line().strip().lower()
            if answer in ("n", "no") or (enter_is_no and not answer):
                return False
            if answer in ("y", "yes"):
                return True

    def pressed(self) -> bool:
        """Return whether a key was pressed since the last question, or whether the terminal was closed.

        Until the next question, the terminal delivers each key immediately and does not echo it.
        """
        if not self._gives_keys:
            if not sys.stdin.isatty():
                return False
            self._raw.enter_context(raw_keys(keep=True))
            self._gives_keys = True
        return bool(self._typed or select.select([sys.stdin], [], [], 0.0)[0])

    def whole_lines(self) -> None:
        """Restore the terminal to line-by-line input."""
        self._raw.close()
        self._gives_keys = False

    def _forget(self) -> None:
        self.whole_lines()
        if sys.stdin.isatty():
            self._typed = b""
            with suppress(termios.error):  # the terminal was closed
                termios.tcflush(sys.stdin, termios.TCIFLUSH)

    def _read(self) -> bytes:
        """Read the available input. The result is empty at the end of the input or if the terminal is closed."""
        try:
            return os.read(sys.stdin.fileno(), CHUNK)
        except OSError:
            return b""

    def _ready(self) -> bool:
        return bool(select.select([sys.stdin], [], [], POLL_S)[0])

    def _go_on(self) -> None:
        if self._signals.count:
            raise self._ended("interrupted")

    def _ended(self, why: str) -> Interrupted:
        return Interrupted(f"{why}: {self.left}" if self.left else why)
