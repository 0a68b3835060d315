"""A program in its own terminal, as over ssh."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.servoloop.served import eventually

PATIENCE_S = 60.0
LINES, COLUMNS = 40, 120
ESCAPE = re.compile(rb"\x1b(\[[0-9;?<=>]*[a-zA-Z]|[()][A-Z0-9]|[=>])")


class Terminal:
    """Pseudo-terminal with a program in it. ``written`` contains the program's output without escape sequences."""

    def __init__(self, *arguments: str, folder: Path) -> None:
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", LINES, COLUMNS, 0, 0))
        self._modes = termios.tcgetattr(theirs)
        self._bytes = bytearray()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "servoloop", *arguments],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            cwd=folder,
            env={**os.environ, "TERM": "xterm-256color", "COLUMNS": str(COLUMNS), "LINES": str(LINES)},
            start_new_session=True,
        )
        self._theirs = theirs
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with suppress(OSError):
            while data := os.read(self._ours, 65536):
                self._bytes += data

    @property
    def written(self) -> str:
        return ESCAPE.sub(b"", bytes(self._bytes)).decode(errors="replace").replace("\u00a0", " ")

    def wait_for(self, *words: str) -> None:
        """Wait until the program has written all these texts since the last call."""

        def there() -> bool:
            assert self.process.poll() is None or all(word in self.written for word in words), self.written
            return all(word in self.written for word in words)

        eventually(there, PATIENCE_S)
        self._bytes.clear()

    def press(self, keys: bytes) -> None:
        os.write(self._ours, keys)

    @property
    def restored(self) -> bool:
        """Return whether the modes and the original screen of the terminal have been restored."""
        left = self._bytes.rfind(b"\x1b[?1049l") > self._bytes.rfind(b"\x1b[?1049h")
        return left and termios.tcgetattr(self._theirs) == self._modes

    def close(self) -> None:
        self.process.kill()
        self.process.wait(PATIENCE_S)
        os.close(self._theirs)
        self._thread.join(PATIENCE_S)
        os.close(self._ours)


@contextmanager
def in_terminal(*arguments: str, folder: Path) -> Iterator[Terminal]:
    """Run ``servoloop`` with these arguments in a terminal until the end of the block."""
    terminal = Terminal(*arguments, folder=folder)
    try:
        yield terminal
    finally:
        terminal.close()
