"""A background worker runs what takes longer than a cycle, each piece of work in a short-lived thread of its own."""

import threading
from collections.abc import Callable
from time import monotonic
from typing import Final

JOIN_S: Final = 10.0
"""Setting up a line of servos takes a second, or a few where they do not answer."""


class BackgroundWorker:
    """The loop's thread calls the worker with the work; ``join`` waits for all that is under way."""

    def __init__(self, join_s: float = JOIN_S) -> None:
        self._join_s = join_s
        self._threads: list[threading.Thread] = []

    def __call__(self, work: Callable[[], None]) -> None:
        """Begin the work; returns at once."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=work, name="hardware change", daemon=True)
        self._threads.append(thread)
        thread.start()

    def join(self) -> None:
        """Wait until nothing is under way. Raises TimeoutError where something still is in the end."""
        deadline_s = monotonic() + self._join_s
        for thread in self._threads:
            thread.join(max(0.0, deadline_s - monotonic()))
            if thread.is_alive():
                raise TimeoutError(f"a {thread.name} is still under way after {self._join_s:.0f} s")


class SameThreadWorker(BackgroundWorker):
    """Runs the work at once, in the loop's thread: on simulated time no other thread makes time pass."""

    def __call__(self, work: Callable[[], None]) -> None:
        work()
