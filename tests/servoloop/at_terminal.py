"""A program in a pseudo-terminal that the test controls."""

import fcntl
import os
import select
import subprocess
import termios
import time
from collections.abc import Sequence

LIMIT_S = 60.0
"""Timeout for a very busy machine, in seconds. No test checks this value as a promise."""


class AtTerminal:
    """Program that runs in a context. The terminal is the controlling terminal of the program, so closing the terminal
    sends SIGHUP."""

    def __init__(self, command: Sequence[str]) -> None:
        self.master, self.slave = os.openpty()
        self.settings = termios.tcgetattr(self.slave)
        self._said = ""
        self.process = subprocess.Popen(
            command,
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )

    def wait_for(self, text: str) -> None:
        """Read the output until it contains this text."""
        deadline_s = time.monotonic() + LIMIT_S
        while text not in self._said:
            assert time.monotonic() < deadline_s and self.process.poll() is None, self._said
            if select.select([self.master], [], [], 0.1)[0]:
                self._said += os.read(self.master, 4096).decode(errors="replace")

    def type(self, text: str) -> None:
        os.write(self.master, text.encode())

    def close(self) -> None:
        """Close the terminal."""
        for descriptor in (self.slave, self.master):
            os.close(descriptor)
        self.slave = self.master = -1

    def __enter__(self) -> "AtTerminal":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        if self.master >= 0:
            self.close()
