"""Count SIGINT, SIGTERM and SIGHUP. The first signal requests a shutdown; a second signal ends the program within 1 s.

SIGHUP never counts as the second signal: when a terminal is closed, the kernel and the shell each send one.
"""

import os
import signal
import threading
import time
from types import FrameType
from typing import Final

from servoloop.stack.terminal import restore_terminals

LAST_S: Final = 1.0
"""Maximum time the program continues after the second signal, in seconds."""
NUMBERS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def end_signals() -> list[signal.Signals]:
    """Return the signals that end a program. SIGHUP is omitted if it is already ignored, as under nohup."""
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return [number for number in NUMBERS if number != signal.SIGHUP or not ignored]


class Signals:
    """Context that counts signals. The previous handlers are restored at the end of the context.

    A thread counts the signals. Signal handlers would run too late, because Python runs them only when the main thread
    returns from a library call. The thread reads the wakeup descriptor, to which Python writes the number of each
    signal immediately.
    """

    def __init__(self, left: str = "") -> None:
        """``left`` describes the state in which an immediate exit leaves the hardware; it is used in the message."""
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

    def __exit__(self, *_: object) -> None:
        for number, handler in self._former.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        signal.set_wakeup_fd(self._former_descriptor)
        os.close(self._writer)

    def ask(self) -> None:
        """Request a shutdown, like the first signal."""
        self.count = max(self.count, 1)

    def _watch(self, reader: int) -> None:
        """Count signals until the descriptor is closed.

        After a second signal, the program still exits within a second even if the context has ended, because a library
        may hang.
        """
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
            restore_terminals()
            os.write(2, f"servoloop: ended at once by a second signal{left}\n".encode())
        finally:
            os._exit(status)


def _wake(number: int, frame: FrameType | None) -> None:
    """Interrupt the main thread's sleep. The watching thread counts the signal."""
