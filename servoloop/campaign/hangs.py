"""Limits of a run: simulated time that goes on without end, and simulated time that stands still."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType
from typing import Final

from servoloop.simulation.job import FALLS_S, LONGEST_S
from servoloop.simulation.schedule import Schedule
from sim_backend.clock import Hang, SimulatedClock

MARGIN_S: Final = 120.0
"""Simulated time that a run may take for activation, recovery and shutdown, beside twice the time of its schedule."""
STANDS_S: Final = 120.0
"""Time of the machine for which the simulated time may stand still."""
BEGINS_S: Final = 600.0
"""The same before the first cycle, when code may have to be compiled."""
LOOK_S: Final = 5.0
"""Time from one look at the simulated time to the next.

Looks are counted, and not seconds: a run does not hang because its process or the machine was stopped for a while.
"""
SIGNAL: Final = signal.SIGUSR1
SHOWN: Final[ContextVar[Callable[[float], None] | None]] = ContextVar("SHOWN", default=None)
"""Called with the simulated time of the runs of this process: a process that watches them sees it so."""


def longest_s(schedule: Schedule) -> float:
    """The simulated time after which a run of the schedule hangs."""
    stalls_s = sum(event.for_s or 0.0 for event in schedule.faults if event.kind == "stall")
    return MARGIN_S + 2.0 * (len(schedule.job) * (LONGEST_S + FALLS_S) + schedule.seconds + stalls_s)


def limit(clock: SimulatedClock, schedule: Schedule) -> None:
    """Have the clock of a run end the run after its longest time, and show its time."""
    clock.last_s = longest_s(schedule)
    clock.on_time = SHOWN.get()


class Standstill:
    """Tells whether a simulated time has stood still for too many looks."""

    def __init__(self, more_s: float = 0.0) -> None:
        """``more_s`` is added to the limits."""
        self._more_s, self._count, self._time_s = more_s, 0, -1.0

    def look(self, time_s: float) -> bool:
        """Look once more; whether the time has stood still for its limit."""
        self._count = self._count + 1 if time_s == self._time_s else 0
        self._time_s = time_s
        return self._count >= (_limit_s(time_s) + self._more_s) / LOOK_S


def stands(time_s: float) -> str:
    """Describe a run whose simulated time stands still."""
    return f"its simulated time stood still for {_limit_s(time_s):g} s of the machine's time"


def _limit_s(time_s: float) -> float:
    return STANDS_S if time_s else BEGINS_S


@contextmanager
def ended_when_it_stands(now: Callable[[], float]) -> Iterator[None]:
    """Raise Hang in the body when the simulated time stands still; in the main thread, which alone hears signals.

    An endless loop in C does not hear them: only another process can end it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    over = threading.Event()

    def raise_hang(number: int, frame: FrameType | None) -> None:
        if not over.is_set():
            raise Hang(stands(now()))

    former = signal.signal(SIGNAL, raise_hang)
    thread = threading.Thread(target=_watch, args=(now, over), name="hangs", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        signal.signal(SIGNAL, former)


def _watch(now: Callable[[], float], over: threading.Event) -> None:
    """Send the signal at each look at a time that stands: a body may catch one of them."""
    standstill = Standstill()
    while not over.wait(LOOK_S):
        if standstill.look(now()):
            signal.pthread_kill(threading.main_thread().ident or 0, SIGNAL)
