"""SIGINT and SIGTERM as a call in a thread of its own. No ROS."""

import os
import signal
import threading
from collections.abc import Callable


def on_stop_signal(call: Callable[[], object]) -> None:
    """Run ``call`` at the first SIGINT or SIGTERM; later ones do nothing. Only in the main thread.

    An ordinary handler would run when the main thread is back in Python, and that one sleeps inside
    the middleware. The wake-up descriptor is written at once, whichever thread gets the signal.
    """
    reader, writer = os.pipe()  # never closed: a signal may come as long as the process lives
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)

    def wait() -> None:
        os.read(reader, 1)
        call()

    threading.Thread(target=wait, name="signals", daemon=True).start()
