"""Control the pace of simulated time: limit its speed, pause it, or run single steps."""

import threading
from collections import deque
from collections.abc import Callable
from math import inf
from time import monotonic
from typing import Final, Protocol

from controller.manager.requests import ENDED, Request
from drivers.driver_errors import DriverError

POLL_S: Final = 0.1
"""Maximum time between two checks while waiting, in seconds of real time."""
LONGEST_CATCH_UP_S: Final = 0.1
"""Maximum delay that the simulation catches up on after running slowly, in seconds of real time.

The simulation does not catch up on longer delays.
"""


class PausedError(DriverError):
    """Raised when steps cannot run, for example because the simulation is not paused."""


def parse_factor(text: str) -> float:
    """Parse the value of ``--rtf``. ``max`` is infinity. Raises DriverError."""
    try:
        factor = inf if text.strip().lower() == "max" else float(text)
    except ValueError:
        factor = 0.0
    if not factor > 0.0:
        raise DriverError(f"--rtf must be max or a factor above 0, such as 0.5 or 5, not {text!r}")
    return factor


class Wall(Protocol):
    """Real-time clock with a wait that another thread can interrupt."""

    def now(self) -> float:
        """Return the time in seconds."""
        ...

    def wait(self, longest_s: float) -> None:
        """Wait for ``longest_s`` seconds, or until another thread calls ``wake``."""
        ...

    def wake(self) -> None: ...


class MachineWall:
    """Monotonic clock of the computer."""

    now = staticmethod(monotonic)

    def __init__(self) -> None:
        self._changed = threading.Event()

    def wait(self, longest_s: float) -> None:
        self._changed.wait(longest_s)
        self._changed.clear()

    def wake(self) -> None:
        self._changed.set()


class Pace:
    """Speed limit, pauses and single steps of a simulation.

    The loop thread waits between cycles. Any thread may pause, resume or request steps.

    ``factor`` is the maximum ratio of simulated to real time, or ``math.inf`` for the maximum speed of the computer.
    """

    def __init__(self, factor: float, paused: bool = False, wall: Wall | None = None) -> None:
        self.paused = paused
        self.on_done: Callable[[], None] = lambda: None
        """Function called in the loop thread when all steps of a request are complete."""
        self._factor = factor
        self._wall = wall or MachineWall()
        self._lock = threading.Lock()
        self._steps: deque[tuple[int, Request[None]]] = deque()
        """Number of remaining cycles of each request."""
        self._ended = False
        self._anchor: tuple[float, float] | None = None
        """Simulated and real time at the reference moment, or None if a new reference moment must be chosen."""
        self._begun_s = self._now_s = 0.0
        self._running_s = 0.0
        self._ran_at_s: float | None = None

    @property
    def summary(self) -> str:
        """Summary of the simulated time, the real time excluding pauses, and their ratio."""
        simulated_s = self._now_s - self._begun_s
        times = f", {simulated_s / self._running_s:.1f} times real time" if self._running_s > 0.0 else ""
        return f"{simulated_s:.1f} s simulated in {self._running_s:.1f} s{times}"

    def pause(self, paused: bool) -> None:
        """Pause after the current cycle, or resume without catching up on the paused time."""
        with self._lock:
            self.paused = paused
            self._anchor = None
        self._wall.wake()

    def step(self, cycles: int) -> Request[None]:
        """Run at least one cycle of a paused simulation. The request is complete after its last cycle."""
        request = Request[None](lambda: None)
        with self._lock:
            if self._ended:
                request.refuse(RuntimeError(ENDED))
            elif not self.paused:
                request.refuse(PausedError("the simulation is not paused: call set_pause first"))
            elif cycles < 1:
                request.refuse(PausedError(f"{cycles} steps requested: request at least one step"))
            else:
                self._steps.append((cycles, request))
        self._wall.wake()
        return request

    def wait(self, time_s: float, ended: Callable[[], bool]) -> None:
        """Wait until the cycle after simulated time ``time_s`` may run, or until ``ended`` returns true.

        ``ended`` is called repeatedly in the loop thread.
        """
        self._count(time_s)
        while not ended():
            with self._lock:
                wait_s = 0.0 if self._take_step() else self._left_s(time_s)
            if wait_s <= 0.0:
                break
            self._wait(min(wait_s, POLL_S))
        self._ran_at_s = self._wall.now()

    def end(self) -> None:
        """Reject all remaining step requests after the last cycle."""
        with self._lock:
            self._ended = True
            while self._steps:
                self._steps.popleft()[1].refuse(RuntimeError(ENDED))

    def _take_step(self) -> bool:
        """Deduct one cycle from the first open request, and complete requests without remaining cycles.

        Return whether a cycle may run.
        """
        while self._steps:
            left, request = self._steps.popleft()
            if left:
                self._steps.appendleft((left - 1, request))
                return True
            request.serve()
            self.on_done()
        return False

    def _left_s(self, time_s: float) -> float:
        """Return the real time until the next cycle may run, in seconds."""
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
        """Update the simulated and real time after a cycle."""
        if self._ran_at_s is None:
            self._begun_s = time_s
        else:
            self._running_s += self._wall.now() - self._ran_at_s
        self._now_s = time_s
