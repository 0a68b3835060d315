"""Printing to a terminal that may go away: what it no longer takes is lost, and no way to an end is cut off by that."""

import errno
import io
import sys
from typing import Any


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
