"""Keys of a terminal that are held. Terminals tell presses and repeats, and no releases: no repeat is a release."""

import errno
import io
import logging
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

import typer

from drivers.printable import PrintableFormatter

FIRST_S: Final = 0.7
"""A key that is held repeats after so long at first: half a second in most terminals."""
REPEAT_S: Final = 0.25
"""And then many times in this; so long after the key is let go it still counts as held."""
_before: dict[int, list[Any]] = {}
"""The settings of terminals that give each key now, from before that, by descriptor."""
NAMES: Final = {"\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left", " ": "space"}


class HeldKey:
    """The key that is held, fed with what was typed; times in s."""

    def __init__(self, tap_s: float) -> None:
        """``tap_s``: so long a key counts as held that was pressed once, until repeats come."""
        self._tap_s = tap_s
        self._key = ""
        self._pressed_s = self._until_s = -1.0
        self._over = False
        """Whether the press counts no more, however long the key is held."""

    def press(self, key: str, now_s: float) -> bool:
        """A key was pressed, or repeats. Returns whether this is a new press."""
        repeats = key == self._key and now_s - self._pressed_s <= FIRST_S
        self._key, self._pressed_s = key, now_s
        self._over = self._over and repeats
        if not self._over:
            self._until_s = now_s + (REPEAT_S if repeats else self._tap_s)
        return not repeats

    def release(self) -> None:
        """Forget the press. A key that is still held counts again only after it was released and pressed."""
        self._until_s, self._over = -1.0, True

    def held(self, now_s: float) -> str:
        """The key; empty where none is held."""
        return self._key if now_s <= self._until_s else ""


def split_keys(text: str) -> Iterator[str]:
    """The names of keys in what a terminal has sent; arrows are up, down, right and left."""
    while text:
        for code, name in NAMES.items():
            if text.startswith(code):
                text = text[len(code) :]
                yield name
                break
        else:
            yield text[0]
            text = text[1:]


def typed(wait_s: float) -> list[str]:
    """What was typed at this terminal; waits so long for it. A terminal that is gone says q, to quit."""
    descriptor = sys.stdin.fileno()
    if not select.select([descriptor], [], [], wait_s)[0]:
        return []
    try:
        text = os.read(descriptor, 1024).decode(errors="replace")
    except OSError:
        text = ""
    return list(split_keys(text)) if text else ["q"]


@contextmanager
def raw_keys(keep: bool = False) -> Iterator[None]:
    """The terminal gives each key as it is pressed, without showing it; at the end all is as it was.

    ``keep``: what was typed before, too. Else it is forgotten.
    """
    descriptor = sys.stdin.fileno()
    before = _before[descriptor] = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor, termios.TCSANOW if keep else termios.TCSAFLUSH)
    try:
        yield
    finally:
        _before.pop(descriptor, None)
        with suppress(termios.error):  # a terminal that is gone
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def put_back() -> None:
    """Leave terminals as they were before ``raw_keys``, for a program that ends at once and gets to no end of it."""
    for descriptor, before in list(_before.items()):  # the main thread may be taking one away
        with suppress(termios.error, OSError):
            if os.tcgetpgrp(descriptor) == os.getpgrp():  # from the background it would stop the program
                termios.tcsetattr(descriptor, termios.TCSANOW, before)


FAILED: Final = 1
"""The exit status of a program that cannot print its result."""


class _Lossy(io.FileIO):
    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return len(data)


def outlive_terminal() -> None:
    """Make stdout and stderr outlive the terminal that they are. Into files and pipes an error stays one."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and stream.isatty():
            buffer = io.BufferedWriter(_Lossy(stream.fileno(), "w", closefd=False))
            setattr(sys, name, io.TextIOWrapper(buffer, stream.encoding, stream.errors, line_buffering=True))


def colors_wanted() -> bool:
    """Whether text may have colors: not if NO_COLOR is set to anything (https://no-color.org)."""
    return not os.environ.get("NO_COLOR")


def print_styled(text: str, err: bool = False, **style: Any) -> None:
    """Print a line with a style, such as ``fg="red"``, if its stream is a terminal and colors are wanted."""
    typer.secho(text, err=err, color=None if colors_wanted() else False, **style)


@contextmanager
def complete_output() -> Iterator[None]:
    """Flush stdout at the end of the block.

    If it takes no more, as a file on a full disk, the program ends with a sentence; if nobody reads it any more, as a
    pipe into ``head``, it ends without one.
    """
    try:
        try:
            yield
        finally:
            _flush()
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EPIPE) or _takes_output():
            raise  # of another file
        _discard_output()
        if error.errno == errno.ENOSPC:
            with suppress(OSError):
                print_styled(f"servoloop: cannot write the output: {error.strerror}", err=True, fg="red")
        raise SystemExit(FAILED) from None


def _flush() -> None:
    if sys.stdout is not None and not sys.stdout.closed:
        sys.stdout.flush()


def _takes_output() -> bool:
    """Whether stdout can still be written: a line more shows it, as Python forgets what could not be written."""
    try:
        os.write(sys.stdout.fileno(), b"\n")
    except (OSError, ValueError):
        return False
    return True


def _discard_output() -> None:
    """Let stdout lead nowhere, so that Python's own flush at the end of the program does not fail again."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


class TerminalHandler(logging.Handler):
    """Prints log records on the stderr of the moment.

    A live table replaces stderr so that lines appear above it; written past it, they would leave pieces of the table.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        with suppress(OSError, ValueError):  # of a terminal or a pipe that is gone, or a full disk
            print(self.format(record), file=sys.stderr, flush=True)


def log_to_terminal() -> None:
    """Print the log of the stack on the terminal."""
    handler = TerminalHandler()
    handler.setFormatter(PrintableFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
