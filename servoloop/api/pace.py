"""Let a program wait for cycles of a control loop that runs in another thread or in simulated time."""

import asyncio
import logging
import threading
from collections.abc import Callable
from typing import Final, Protocol

from controller.loop import ControlLoop
from drivers.clock import Clock
from servoloop.api.arm_errors import ArmEndedError, ArmError

LOG = logging.getLogger("servoloop")
POLL_S: Final = 0.005
"""Period at which an asynchronous wait checks its condition, in seconds."""
CHECK_S: Final = 0.1
"""Maximum time between two condition checks of a blocking wait, in seconds. A loop may end without waking the waiting
thread."""

Ended = Callable[[], ArmEndedError | None]
"""Function that returns the error of a control loop that has ended, or None while the loop is running."""


class LoopPace(Protocol):
    """Interface through which a program waits for cycles of a control loop."""

    def cycle_done(self) -> None:
        """Wake the waiting threads and call the observers. The loop's thread calls this method after each cycle."""
        ...

    def watch(self, observer: Callable[[], None]) -> Callable[[], None]:
        """Call a function after each cycle, and return a function that ends the calls."""
        ...

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a condition, like ``ArmBackend.wait``."""
        ...

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a condition, like ``ArmBackend.wait_async``."""
        ...

    def close(self) -> None:
        """Stop calling observers."""
        ...


class Observers:
    """Functions that are called after a cycle.

    An error in one function is logged once and does not affect the other functions.
    """

    def __init__(self) -> None:
        self._observers: tuple[Callable[[], None], ...] = ()
        self._failed: set[Callable[[], None]] = set()

    def add(self, observer: Callable[[], None]) -> Callable[[], None]:
        """Add a function, and return a function that removes it."""
        self._observers += (observer,)

        def remove() -> None:
            self._observers = tuple(one for one in self._observers if one is not observer)

        return remove

    def __bool__(self) -> bool:
        return bool(self._observers)

    def call(self) -> None:
        """Call all functions."""
        for observer in self._observers:
            try:
                observer()
            except Exception:
                if observer not in self._failed:
                    LOG.exception("an on_state callback failed; the arm keeps running")
                self._failed.add(observer)


class ThreadPace:
    """Pace of a loop that runs in its own thread. Observers run in a separate thread, so that they do not delay
    cycles."""

    def __init__(self, clock: Clock, ended: Ended) -> None:
        """``clock`` is the loop's clock, and ``ended`` returns an error if the loop has ended."""
        self._clock, self._ended = clock, ended
        self._changed = threading.Condition()
        """Lock that is held only briefly, because the loop's thread needs it in each cycle."""
        self._cycles = 0
        self._observers = Observers()
        self._due = threading.Event()
        self._thread: threading.Thread | None = None
        self._closed = False

    def cycle_done(self) -> None:
        with self._changed:
            self._cycles += 1
            self._changed.notify_all()
        if self._observers:
            self._due.set()

    def watch(self, observer: Callable[[], None]) -> Callable[[], None]:
        if self._thread is None:
            self._thread = threading.Thread(target=self._call_observers, name="on_state", daemon=True)
            self._thread.start()
        return self._observers.add(observer)

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        end_s = self._clock.now() + timeout_s
        while True:
            seen = self._cycles
            if until():
                return True
            left_s = end_s - self._clock.now()
            if left_s <= 0.0:
                return False
            if error := self._ended():
                raise error
            with self._changed:
                if self._cycles == seen:
                    self._changed.wait(min(left_s, CHECK_S))

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        end_s = self._clock.now() + timeout_s
        while not until():
            if self._clock.now() >= end_s:
                return False
            if error := self._ended():
                raise error
            await asyncio.sleep(POLL_S)
        return True

    def close(self) -> None:
        self._closed = True
        self._due.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(CHECK_S)

    def _call_observers(self) -> None:
        while not self._closed:
            self._due.wait()
            self._due.clear()
            if not self._closed:
                self._observers.call()


class SimulatedPace:
    """Pace of a loop in simulated time. Waiting runs the cycles in the calling thread, as fast as possible."""

    def __init__(self, loop: ControlLoop, ended: Ended, failed: Callable[[Exception], None]) -> None:
        """``failed`` is called with the error that ended the loop. After this call, ``ended`` returns an error."""
        self._loop, self._ended, self._failed = loop, ended, failed
        self._observers = Observers()
        self._lock = threading.RLock()
        self._runs = False
        self._due_s = loop.clock.now()
        """Time at which the next cycle is due, in seconds.

        Tracking this time keeps the loop rate constant across waits of any length.
        """

    def cycle_done(self) -> None:
        self._observers.call()

    def watch(self, observer: Callable[[], None]) -> Callable[[], None]:
        return self._observers.add(observer)

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        end_s = self._loop.clock.now() + timeout_s
        while not until():
            if self._due_s > end_s:
                self._loop.clock.sleep_until(end_s)
                return False
            self._run_cycle()
        return True

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        end_s = self._loop.clock.now() + timeout_s
        while not until():
            if self._due_s > end_s:
                self._loop.clock.sleep_until(end_s)
                return False
            self._run_cycle()
            await asyncio.sleep(0.0)  # Let other tasks run between two cycles.
        return True

    def close(self) -> None:
        pass

    def _run_cycle(self) -> None:
        with self._lock:
            if error := self._ended():
                raise error
            if self._runs:
                raise ArmError(
                    "an on_state callback cannot wait in simulated time: set a flag, then wait in the program"
                )
            self._runs = True
            cycles = iter((False, True))
            try:
                self._loop.clock.sleep_until(self._due_s)
                self._due_s = self._loop.clock.now() + self._loop.period_s
                self._loop.run(lambda: next(cycles))
            except Exception as error:
                self._failed(error)
                raise (self._ended() or error) from error
            finally:
                self._runs = False
