"""Printing to a terminal that may go away, to a disk that may be full, and with colors only if they are wanted.

What a terminal no longer takes is lost, and no way to an end is cut off by that.
"""

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

import typer

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
