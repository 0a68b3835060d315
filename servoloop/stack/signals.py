"""SIGINT, SIGTERM and SIGHUP as a count: the first asks for a calm end, a second ends the program in a second.

SIGHUP, of a terminal that was closed, is never the second: the kernel and the shell each send one.
"""

import os
import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Final

from servoloop.stack.terminal import put_back

LAST_S: Final = 1.0
"""So long the program may go on after the second signal, for what it can still end well by itself."""
NUMBERS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def end_signals() -> list[signal.Signals]:
    """The signals that end a program; not SIGHUP where it is ignored already: that is what nohup is for."""
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return [number for number in NUMBERS if number != signal.SIGHUP or not ignored]


class Signals:
    """Signals counts signals within its context; the former handlers come back at its end.

    A thread counts and not the handlers: these run when the main thread is back in Python, and that one may be waiting
    inside a library. The descriptor to which Python writes each signal's number is written at once.
    """

    def __init__(self, left: str = "") -> None:
        """``left``: how the program leaves what it drives when it ends at once."""
        self.count = 0
        self._left = left
        self._former: dict[int, object] = {}
        self._former_descriptor = -1

    def __enter__(self) -> "Signals":
        reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._former_descriptor = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        for number in end_signals():
            self._former[number] = signal.signal(number, _wake)
        threading.Thread(target=self._watch, args=(reader,), name="signals", daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, handler in self._former.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        signal.set_wakeup_fd(self._former_descriptor)
        os.close(self._writer)

    def ask(self) -> None:
        """Ask for the end as the first signal does."""
        self.count = max(self.count, 1)

    def _watch(self, reader: int) -> None:
        """Count until the descriptor is closed. The last second goes on behind the context's end: so may a library."""
        while number := os.read(reader, 1):
            if number[0] == signal.SIGHUP:
                self.ask()
            else:
                self.count += number[0] in NUMBERS
            if self.count > 1:
                self._end_soon(128 + number[0])
        os.close(reader)

    def _end_soon(self, status: int) -> None:
        time.sleep(LAST_S)
        left = f": {self._left}" if self._left else ""
        try:
            put_back()
            os.write(2, f"servoloop: a second signal: ended at once{left}\n".encode())
        finally:
            os._exit(status)


def _wake(number: int, frame: FrameType | None) -> None:
    """Interrupt a sleep of the main thread; what is to be done is the count's."""
