"""Run tasks that take longer than a control cycle, each in its own short-lived thread."""

import threading
from collections.abc import Callable
from time import monotonic
from typing import Final

JOIN_S: Final = 10.0
"""Maximum time for all tasks to end, in seconds. Setting up a bus takes a few seconds if its servos do not respond."""


class BackgroundWorker:
    """Worker that runs each task in a new thread.

    The loop thread calls the worker once per task.
    """

    def __init__(self, join_s: float = JOIN_S) -> None:
        self._join_s = join_s
        self._threads: list[threading.Thread] = []

    def __call__(self, work: Callable[[], None]) -> None:
        """Start a task and return immediately."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=work, name="hardware change", daemon=True)
        self._threads.append(thread)
        thread.start()

    def join(self) -> None:
        """Wait for all running tasks. Raises TimeoutError if a task is still running at the deadline."""
        deadline_s = monotonic() + self._join_s
        for thread in self._threads:
            thread.join(max(0.0, deadline_s - monotonic()))
            if thread.is_alive():
                raise TimeoutError(f"a {thread.name} is still running after {self._join_s:.0f} s")


class SameThreadWorker(BackgroundWorker):
    """Worker for simulated time, in which only the loop thread advances the clock.

    This worker runs each task immediately.
    """

    def __call__(self, work: Callable[[], None]) -> None:
        work()
