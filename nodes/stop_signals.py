"""Call a function in a separate thread on SIGINT, SIGTERM or SIGHUP. Imports no ROS package."""

import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Final

LAST_S: Final = 1.0
"""Time from the second signal until the process exits, in seconds, as in servoloop/stack/signals.py."""

ARM_CONTINUES: Final = "The arm finishes its current motion and holds its position."
"""Consequence for the arm if a program that sends motions to the stack exits immediately."""


def on_stop_signal(call: Callable[[], object], consequence: str = "") -> None:
    """Run ``call`` on the first signal, and exit on the second signal. This function must be called in the main
    thread. The process then prints ``consequence``, a sentence about the state of the arm.

    A SIGHUP is never treated as the second signal, because the kernel and the shell both send one when a terminal is
    closed. If SIGHUP is ignored, for example under nohup, it remains ignored.

    An ordinary handler would run only when the main thread returns to Python, but that thread is blocked in the
    middleware. Python writes to the wake-up descriptor immediately, regardless of which thread receives the signal.
    """
    reader, writer = os.pipe()  # The pipe stays open until the process exits.
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda *_: None)

    def wait() -> None:
        os.read(reader, 1)
        call()
        while (number := os.read(reader, 1)[0]) == signal.SIGHUP:
            pass
        time.sleep(LAST_S)
        text = f"second signal: ended at once. {consequence}".rstrip()
        os.write(2, f"{text}\n".encode())
        os._exit(128 + number)

    threading.Thread(target=wait, name="signals", daemon=True).start()
