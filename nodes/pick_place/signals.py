"""SIGINT, SIGTERM and SIGHUP as a call in a thread of its own. No ROS."""

import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Final

LAST_S: Final = 1.0
"""From the second signal to the end of the process, as in servoloop/stack/signals.py."""


def on_stop_signal(call: Callable[[], object]) -> None:
    """Run ``call`` at the first signal; a second one ends the process. Only in the main thread.

    SIGHUP, of a terminal that was closed, is never the second: the kernel and the shell each send one. Where it is
    ignored, as under nohup, it stays so.

    An ordinary handler would run when the main thread is back in Python, and that one sleeps inside
    the middleware. The wake-up descriptor is written at once, whichever thread gets the signal.
    """
    reader, writer = os.pipe()  # never closed: a signal may come as long as the process lives
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
        os.write(2, b"a second signal: ended at once. The arm finishes the motion under way and holds there\n")
        os._exit(128 + number)

    threading.Thread(target=wait, name="signals", daemon=True).start()
