"""Read keys from a terminal, and print text and log messages to it."""

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
"""Maximum time until a held key starts to repeat, in seconds. Most terminals repeat after 0.5 s."""
REPEAT_S: Final = 0.25
"""Maximum time between later repeats, in seconds. After a key is released, it is still considered held for this
time."""
_before: dict[int, list[Any]] = {}
"""Original settings of terminals in raw mode, keyed by file descriptor."""
NAMES: Final = {"\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left", " ": "space"}


class HeldKey:
    """Key that is held down. All times are in seconds.

    Terminals report presses and repeats, but not releases. A key is considered released when it stops repeating.
    """

    def __init__(self, tap_s: float) -> None:
        """``tap_s`` is how long a key is considered held after a single press, before its repeats start."""
        self._tap_s = tap_s
        self._key = ""
        self._pressed_s = self._until_s = -1.0
        self._over = False
        """Whether the current press is ignored until the key is released."""

    def press(self, key: str, now_s: float) -> bool:
        """Process a press or a repeat of a key, and return whether it is a new press."""
        repeats = key == self._key and now_s - self._pressed_s <= FIRST_S
        self._key, self._pressed_s = key, now_s
        self._over = self._over and repeats
        if not self._over:
            self._until_s = now_s + (REPEAT_S if repeats else self._tap_s)
        return not repeats

    def release(self) -> None:
        """Ignore the current press. The key is considered held again only after it is released and pressed again."""
        self._until_s, self._over = -1.0, True

    def held(self, now_s: float) -> str:
        """Return the held key, or an empty string if no key is held."""
        return self._key if now_s <= self._until_s else ""


def split_keys(text: str) -> Iterator[str]:
    """Yield the names of the keys in terminal input. Arrow keys are returned as up, down, right and left."""
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
    """Wait for key presses, and return the pressed keys. For a closed terminal, return q, the key to quit."""
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
    """Read each key as it is pressed, without echo. Restore the terminal settings at the end.

    ``keep`` states whether to keep earlier input instead of discarding it.
    """
    descriptor = sys.stdin.fileno()
    before = _before[descriptor] = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor, termios.TCSANOW if keep else termios.TCSAFLUSH)
    try:
        yield
    finally:
        _before.pop(descriptor, None)
        with suppress(termios.error):  # the terminal may be closed
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def restore_terminals() -> None:
    """Restore all terminals changed by ``raw_keys``, in a program that exits without leaving its contexts."""
    for descriptor, before in list(_before.items()):  # The list is a copy, because the main thread may remove entries.
        with suppress(termios.error, OSError):
            if os.tcgetpgrp(descriptor) == os.getpgrp():  # Changing the settings would stop a background program.
                termios.tcsetattr(descriptor, termios.TCSANOW, before)


FAILED: Final = 1
"""Exit status of a program that cannot print its result."""


class _Lossy(io.FileIO):
    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return len(data)


def open_missing_streams() -> None:
    """Open the null device for each standard stream that was closed when the program started.

    Without this, Python sets the stream to None, and the next file that the program opens, such as a port, gets the
    descriptor of the stream.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


def escape_output() -> None:
    """Escape characters that stdout cannot encode, such as those of file names that are not UTF-8, as on stderr."""
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def outlive_terminal() -> None:
    """Ignore errors on stdout and stderr if their terminal has been closed. Errors on files and pipes are still
    reported."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and stream.isatty():
            buffer = io.BufferedWriter(_Lossy(stream.fileno(), "w", closefd=False))
            setattr(sys, name, io.TextIOWrapper(buffer, stream.encoding, stream.errors, line_buffering=True))


def colors_wanted() -> bool:
    """Return whether text may have colors. Colors are off if NO_COLOR is set to any value (https://no-color.org)."""
    return not os.environ.get("NO_COLOR")


def print_styled(text: str, err: bool = False, **style: Any) -> None:
    """Print a line in a style, such as ``fg="red"``; the style is used only if the stream is a terminal and colors are
    wanted."""
    typer.secho(text, err=err, color=None if colors_wanted() else False, **style)


@contextmanager
def complete_output() -> Iterator[None]:
    """Flush stdout at the end of the context.

    If stdout cannot be written, as on a full disk, exit with a message. If the program that reads stdout has
    exited, as with a pipe to ``head``, exit without a message.
    """
    try:
        try:
            yield
        finally:
            _flush()
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EPIPE) or _takes_output():
            raise  # The error comes from another file.
        _discard_output()
        if error.errno == errno.ENOSPC:
            with suppress(OSError):
                print_styled(f"servoloop: cannot write the output: {error.strerror}", err=True, fg="red")
        raise SystemExit(FAILED) from None


def _flush() -> None:
    if sys.stdout is not None and not sys.stdout.closed:
        sys.stdout.flush()


def _takes_output() -> bool:
    """Return whether stdout is writable.

    The function tests this by writing an empty line. A second flush would not show the error, because Python discards
    data that it failed to write.
    """
    try:
        os.write(sys.stdout.fileno(), b"\n")
    except (OSError, ValueError):
        return False
    return True


def _discard_output() -> None:
    """Redirect stdout to the null device, so that Python's flush at exit does not fail again."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


class TerminalHandler(logging.Handler):
    """Log handler that prints to the current stderr.

    A live table replaces stderr, so that log lines appear above the table and do not break it.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        with suppress(OSError, ValueError):  # the terminal or pipe may be closed, or the disk full
            print(self.format(record), file=sys.stderr, flush=True)


def log_to_terminal() -> None:
    """Print the stack's log to the terminal."""
    handler = TerminalHandler()
    handler.setFormatter(PrintableFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
