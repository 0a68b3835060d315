"""Publish the cycles of the control loop in a separate thread, which the loop wakes without waiting for it."""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from hal.types import JointState

KEPT_CYCLES: Final = 100
"""Maximum number of cycles that can wait to be published. Older cycles are discarded without being published."""
STOP_S: Final = 1.0
"""Maximum time to wait for the thread to end, in seconds."""


class CyclePublisher:
    """Thread that publishes the posted cycles. The loop thread calls ``post``."""

    def __init__(self, publish: Callable[[Sequence[JointState]], None]) -> None:
        """Create the thread. The function ``publish`` publishes one or more cycles in order and must not raise an
        exception."""
        self._publish = publish
        self._cycles: deque[JointState] = deque(maxlen=KEPT_CYCLES)
        self._posted = self._published = 0
        """Number of queued cycles and number of published cycles. Each counter is written by only one thread."""
        self._caught_up = threading.Condition()
        self._idle = threading.Lock()
        """Lock that is held until a cycle is posted. The loop thread only releases this lock, so it never waits for the
        publishing thread."""
        self._idle.acquire()
        self._ended = False
        self._thread = threading.Thread(target=self._work, name="cycle publisher", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def post(self, state: JointState) -> None:
        """Queue a completed cycle without blocking."""
        self._cycles.append(state)
        self._posted += 1
        self._wake()

    def wait_until_published(self, longest_s: float) -> bool:
        """Wait up to ``longest_s`` seconds for all posted cycles to be published. Return whether all of them were
        published in time."""
        with self._caught_up:
            return self._caught_up.wait_for(lambda: self._published >= self._posted, longest_s)

    def stop(self) -> None:
        """Publish the remaining cycles and stop the thread."""
        self._ended = True
        self._wake()
        if self._thread.is_alive():
            self._thread.join(STOP_S)

    def _wake(self) -> None:
        with suppress(RuntimeError):  # The thread has not yet noticed the previous cycle.
            self._idle.release()

    def _work(self) -> None:
        ended = False
        while not ended:
            self._idle.acquire()
            ended, posted = self._ended, self._posted
            if states := [self._cycles.popleft() for _ in range(len(self._cycles))]:
                self._publish(states)
            with self._caught_up:
                self._published = posted
                self._caught_up.notify_all()
