"""Work that takes longer than a cycle, each piece in a short-lived thread of its own."""

import threading
from collections.abc import Callable


class Aside:
    """Called with the work by the loop's thread; ``join`` waits for all that is under way."""

    def __init__(self) -> None:
        self._threads: list[threading.Thread] = []

    def __call__(self, work: Callable[[], None]) -> None:
        """Begin it; returns at once."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=work, name="hardware change")
        self._threads.append(thread)
        thread.start()

    def join(self) -> None:
        """Until nothing is under way."""
        for thread in self._threads:
            thread.join()
