"""How tools print: one JSON document for programs, tables for people."""

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

from drivers.errors import DriverError
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals
from servoloop.stack.terminal import raw_keys

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


UNLIMITED: Final = 1000
"""More columns than any table needs."""
JsonOption = Annotated[bool, typer.Option("--json", help="One JSON document instead of tables.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask.")]


def print_json(value: Any) -> None:
    """Print a dataclass, or a list or mapping of them."""
    typer.echo(json.dumps(value, default=_plain, indent=2))


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def print_table(console: "Console", table: "Table", *texts: str) -> None:
    """Print a table without cutting anything, also where it is wider than the terminal.

    Args:
        console: The terminal.
        table: The table.
        texts: The headings of the columns that are wrapped first; the others are wrapped in a narrow terminal only.
    """
    table.show_edge = table.pad_edge = False
    for column in table.columns:
        column.overflow = "fold"
        column.no_wrap = str(column.header) not in texts
    if console.measure(table, options=console.options.update(max_width=UNLIMITED)).minimum > console.width:
        for column in table.columns:
            column.no_wrap = False
    console.print(table)


def confirm(question: str, yes: bool) -> None:
    """Ask unless ``yes``; without a yes nothing is done, and the exit status is 1."""
    if yes:
        return
    try:
        typer.confirm(question, abort=True, err=True)
    except typer.Abort as error:
        if isinstance(error.__context__, EOFError):
            raise DriverError("the question has no answer, so nothing was done: answer it at a terminal") from None
        raise


LOOK_S: Final = 0.03
CHUNK: Final = 4096


class Keyboard:
    """Reads lines from standard input. Nobody else may read there: several lines can come at once."""

    def __init__(self, signals: Signals, left: str = "") -> None:
        """``left``: what is said of how things are left, behind the reason for an interruption."""
        self.left = left
        self._signals = signals
        self._typed = b""
        self._raw = ExitStack()
        self._gives_keys = False

    def line(self) -> str | None:
        """The next line, if one comes within ``LOOK_S``. Raises Interrupted after a signal, and at the input's end."""
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
        """Wait for a line; ``meanwhile`` is called all the while."""
        while (line := self.line()) is None:
            meanwhile()
        return line

    def agrees(self, question: str, enter_is_no: bool = True) -> bool:
        """Ask a question that y or n answers; anything else is asked again, and Enter alone where it does not mean no.

        What was typed at a terminal before the question is forgotten: it was meant for something else.
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
        """Whether somebody pressed a key at a terminal since the last question, any key; a terminal that is gone too.

        From here to the next question the terminal gives each key as it is pressed, and shows none.
        """
        if not self._gives_keys:
            if not sys.stdin.isatty():
                return False
            self._raw.enter_context(raw_keys(keep=True))
            self._gives_keys = True
        return bool(self._typed or select.select([sys.stdin], [], [], 0.0)[0])

    def whole_lines(self) -> None:
        """The terminal waits for whole lines again, as it did before."""
        self._raw.close()
        self._gives_keys = False

    def _forget(self) -> None:
        self.whole_lines()
        if sys.stdin.isatty():
            self._typed = b""
            with suppress(termios.error):  # it is gone now
                termios.tcflush(sys.stdin, termios.TCIFLUSH)

    def _read(self) -> bytes:
        """What was typed; nothing at the input's end, and from a terminal that is gone."""
        try:
            return os.read(sys.stdin.fileno(), CHUNK)
        except OSError:
            return b""

    def _ready(self) -> bool:
        return bool(select.select([sys.stdin], [], [], LOOK_S)[0])

    def _go_on(self) -> None:
        if self._signals.count:
            raise self._ended("interrupted")

    def _ended(self, why: str) -> Interrupted:
        return Interrupted(f"{why}: {self.left}" if self.left else why)
