"""The pace of simulated time: so many times as fast as real time at most, or paused, or step by step."""

import threading
from collections import deque
from collections.abc import Callable
from math import inf
from time import monotonic
from typing import Final, Protocol

from controller.manager.requests import ENDED, Request
from drivers.errors import DriverError

LOOK_S: Final = 0.1
"""Seconds of real time after which whoever waits looks up at the latest."""
LONGEST_CATCH_UP_S: Final = 0.1
"""Real time that is made up for where the machine was slow; what is beyond is lost, and no rush comes behind it."""


class PausedError(DriverError):
    """Only a simulation that is paused can be stepped."""


def parse_factor(text: str) -> float:
    """Parse a factor; ``max`` is infinity. Raises DriverError."""
    try:
        factor = inf if text.strip().lower() == "max" else float(text)
    except ValueError:
        factor = 0.0
    if not factor > 0.0:
        raise DriverError(f"--rtf takes a factor above 0, such as 0.5 or 5, or max, not {text!r}")
    return factor


class Wall(Protocol):
    """Real time: to be looked at, and to be waited for until something changes."""

    def now(self) -> float:
        """Seconds."""
        ...

    def wait(self, longest_s: float) -> None:
        """Return after ``longest_s``, or sooner when another thread calls ``wake``."""
        ...

    def wake(self) -> None: ...


class MachineWall:
    """The machine's monotonic clock."""

    now = staticmethod(monotonic)

    def __init__(self) -> None:
        self._changed = threading.Event()

    def wait(self, longest_s: float) -> None:
        self._changed.wait(longest_s)
        self._changed.clear()

    def wake(self) -> None:
        self._changed.set()


class Pace:
    """The loop's thread waits here between two cycles. Any thread may pause, go on, and ask for steps.

    ``factor``: seconds of the simulation in one of real time, ``math.inf`` for as many as the machine can.
    """

    def __init__(self, factor: float, paused: bool = False, wall: Wall | None = None) -> None:
        self.paused = paused
        self.on_done: Callable[[], None] = lambda: None
        """Called in the loop's thread when steps are done."""
        self._factor = factor
        self._wall = wall or MachineWall()
        self._lock = threading.Lock()
        self._steps: deque[tuple[int, Request[None]]] = deque()
        """The cycles that are left of each request."""
        self._ended = False
        self._anchor: tuple[float, float] | None = None
        """A moment on both clocks, simulated and real; None where another one is to be taken."""
        self._begun_s = self._now_s = 0.0
        self._running_s = 0.0
        self._ran_at_s: float | None = None

    @property
    def summary(self) -> str:
        """How fast it went, in words; without the pauses."""
        simulated_s = self._now_s - self._begun_s
        times = f", {simulated_s / self._running_s:.1f} times real time" if self._running_s > 0.0 else ""
        return f"{simulated_s:.1f} s simulated in {self._running_s:.1f} s{times}"

    def pause(self, paused: bool) -> None:
        """Stop simulated time behind the cycle that runs, or let it go on without making up for the pause."""
        with self._lock:
            self.paused = paused
            self._anchor = None
        self._wall.wake()

    def step(self, cycles: int) -> Request[None]:
        """Run so many cycles, 1 at least, of a paused simulation. The request is done behind the last one."""
        request = Request[None](lambda: None)
        with self._lock:
            if self._ended:
                request.refuse(RuntimeError(ENDED))
            elif not self.paused:
                request.refuse(PausedError("the simulation is not paused: call set_pause first"))
            elif cycles < 1:
                request.refuse(PausedError(f"{cycles} steps: ask for one at least"))
            else:
                self._steps.append((cycles, request))
        self._wall.wake()
        return request

    def wait(self, time_s: float, look: Callable[[], bool]) -> None:
        """Return when the cycle behind simulated ``time_s`` may run, or as soon as ``look`` is true.

        ``look`` is called again and again in the loop's thread.
        """
        self._count(time_s)
        while not look():
            with self._lock:
                wait_s = 0.0 if self._take_step() else self._left_s(time_s)
            if wait_s <= 0.0:
                break
            self._wait(min(wait_s, LOOK_S))
        self._ran_at_s = self._wall.now()

    def end(self) -> None:
        """After the last cycle: refuse all steps that are left."""
        with self._lock:
            self._ended = True
            while self._steps:
                self._steps.popleft()[1].refuse(RuntimeError(ENDED))

    def _take_step(self) -> bool:
        """Take one cycle of the first request; those that have had theirs are done."""
        while self._steps:
            left, request = self._steps.popleft()
            if left:
                self._steps.appendleft((left - 1, request))
                return True
            request.serve()
            self.on_done()
        return False

    def _left_s(self, time_s: float) -> float:
        """Real time until the next cycle may run."""
        if self.paused:
            return inf
        now_s = self._wall.now()
        if self._anchor is None:
            self._anchor = time_s, now_s
        left_s = self._anchor[1] + (time_s - self._anchor[0]) / self._factor - now_s
        if left_s < -LONGEST_CATCH_UP_S:
            self._anchor = time_s, now_s
        return left_s

    def _wait(self, seconds: float) -> None:
        paused, before_s = self.paused, self._wall.now()
        self._wall.wait(seconds)
        if not paused:
            self._running_s += self._wall.now() - before_s

    def _count(self, time_s: float) -> None:
        """Count the cycle that has run since the last call."""
        if self._ran_at_s is None:
            self._begun_s = time_s
        else:
            self._running_s += self._wall.now() - self._ran_at_s
        self._now_s = time_s
