"""Detect and end runs that hang, in this process or in a supervised process that is replaced when it ends."""

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.sharedctypes import RawValue
from pickle import loads
from types import FrameType
from typing import Any, Final, TypeVar

from drivers.driver_errors import DriverError
from servoloop.simulation.job import FALLS_S, LONGEST_S
from servoloop.simulation.schedule import Schedule
from servoloop.stack.processes import end_with_parent
from sim_backend.clock import Hang, SimulatedClock

T = TypeVar("T")
Item = TypeVar("Item")

MARGIN_S: Final = 120.0
"""Simulated time for activation, recovery and shutdown, in addition to twice the scheduled duration, in seconds."""
STANDS_S: Final = 120.0
"""Maximum real time that a run's simulated time may stand still, in seconds."""
BEGINS_S: Final = 600.0
"""Maximum real time that the simulated time may stand still before the first cycle, in seconds.

Code may have to be compiled during this time.
"""
POLL_S: Final = 5.0
"""Interval at which the simulated time is polled, in seconds.

The limits above are counted in polls, so that pausing the process or the machine does not count as a hang.
"""
GRACE_S: Final = 30.0
"""Time that a supervised process has to end a run whose simulated time is not advancing, in seconds, before it is
killed."""
ENDS_S: Final = 5.0
"""Maximum time an idle process may take to end, in seconds."""
RUNS_OF_A_PROCESS: Final = 100
"""Number of runs after which a process is replaced. A hundred runs leak about 200 MB of memory."""
SIGNAL: Final = signal.SIGUSR1
ON_TIME: Final[ContextVar[Callable[[float], None] | None]] = ContextVar("ON_TIME", default=None)
"""Function that is called with the simulated time of runs in this process, so that a supervisor can monitor them."""
CONTEXT: Final = get_context("spawn")
CHILDREN: Final = threading.Lock()
"""Lock for starting and joining processes, because multiprocessing also joins processes that another thread started."""


class WorkerError(DriverError):
    """Processes are killed repeatedly, or cannot be started."""


def longest_s(schedule: Schedule) -> float:
    """Return the simulated time after which a run of the schedule counts as hanging, in seconds."""
    stalls_s = sum(event.for_s or 0.0 for event in schedule.faults if event.kind == "stall")
    return MARGIN_S + 2.0 * (len(schedule.job) * (LONGEST_S + FALLS_S) + schedule.seconds + stalls_s)


def limit(clock: SimulatedClock, schedule: Schedule) -> None:
    """Let the clock of a run end the run at its time limit, and report its time to the supervisor."""
    clock.last_s = longest_s(schedule)
    clock.on_time = ON_TIME.get()


class ClockStandstill:
    """Detector for a simulated time that has not advanced for too many polls."""

    def __init__(self, more_s: float = 0.0) -> None:
        """Add ``more_s`` seconds to the limits."""
        self._more_s, self._count, self._time_s = more_s, 0, -1.0

    def poll(self, time_s: float) -> bool:
        """Return whether the simulated time has been unchanged for too many consecutive polls."""
        self._count = self._count + 1 if time_s == self._time_s else 0
        self._time_s = time_s
        return self._count >= (_limit_s(time_s) + self._more_s) / POLL_S


def stands(time_s: float) -> str:
    """Describe a run whose simulated time is not advancing."""
    return f"its simulated time did not advance for {_limit_s(time_s):g} s of real time"


def _limit_s(time_s: float) -> float:
    return STANDS_S if time_s else BEGINS_S


@contextmanager
def ended_when_it_stands(now: Callable[[], float]) -> Iterator[None]:
    """Raise Hang within the context if the simulated time stops advancing.

    The context works only in the main thread, which receives the signals. An endless loop in C can be ended only by
    another process.
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
    """Send the signal at every poll while the time is not advancing, because code within the context may catch the
    exception."""
    standstill = ClockStandstill()
    while not over.wait(POLL_S):
        if standstill.poll(now()):
            signal.pthread_kill(threading.main_thread().ident or 0, SIGNAL)


@dataclass(frozen=True, slots=True)
class Loss:
    """A run without a result, because its process ended or was killed after the run hung."""

    hung: bool
    time_s: float
    """Simulated time of the run, in seconds."""
    text: str


class Supervisor:
    """Supervisor that executes runs in a separate process and replaces that process when it ends or hangs.

    ``close`` ends the process.
    """

    def __init__(self) -> None:
        self._process: SpawnProcess | None = None
        self._connection: Connection | None = None
        self._time: Any = None
        """The simulated time of the current run, written by the process."""
        self._done = 0

    def run(self, run: Callable[[Item], T], item: Item) -> T | Loss:
        """Execute one run. Raises any exception of the run, and WorkerError if a process cannot be started."""
        if self._process is None or self._done >= RUNS_OF_A_PROCESS:
            self._renew()
        self._done += 1
        self._time.value = 0.0
        assert self._connection is not None
        try:
            self._connection.send((run, item))
            if self._hangs():
                return self._lose(stands(self._time.value))
            result, error = self._connection.recv()
        except (EOFError, OSError):
            return self._lose()
        if error is not None:
            raise error
        return result  # type: ignore[no-any-return]

    def close(self) -> None:
        """End the process, if there is one."""
        if self._process is None:
            return
        assert self._connection is not None
        self._connection.close()
        self._collect(self._process)

    def _hangs(self) -> bool:
        """Wait for the result, and return whether the run is hanging."""
        assert self._connection is not None
        standstill = ClockStandstill(GRACE_S)
        while not self._connection.poll(POLL_S):
            if standstill.poll(self._time.value):
                return True
        return False

    def _renew(self) -> None:
        self.close()
        self._connection, its_own = Pipe()
        self._time, self._done = RawValue("d", 0.0), 0
        process = CONTEXT.Process(target=_work, args=(its_own, self._time), daemon=True)
        try:
            with CHILDREN, blocked_signals():
                process.start()
        except OSError as error:
            raise WorkerError(f"cannot start a process: {error}. Use fewer processes: set --jobs") from None
        its_own.close()
        self._process = process

    def _lose(self, hang: str = "") -> Loss:
        """Return the description of a lost run, whose process has ended.

        If ``hang`` is given, the process is killed first.
        """
        assert self._process is not None
        if hang:
            self._process.kill()
        status = self._collect(self._process)
        return Loss(bool(hang), self._time.value, hang or f"its process {_ending(status)}")

    def _collect(self, process: SpawnProcess) -> int | None:
        """Wait up to ``ENDS_S`` for a process to end, kill it if necessary, and return its exit status."""
        wait([process.sentinel], ENDS_S)
        with CHILDREN:
            process.kill()
            process.join()
        self._process = None
        return process.exitcode


def _ending(status: int | None) -> str:
    if status is None or status >= 0:
        return f"ended with status {status}"
    name = next((one.name for one in signal.Signals if one == -status), f"signal {-status}")
    return f"was ended by {name}"


@contextmanager
def blocked_signals() -> Iterator[None]:
    """Block Ctrl-C and the terminal hangup signal for threads and processes that start within the context."""
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


def _work(connection: Connection, shared_time: Any) -> None:
    """Execute runs until the supervisor closes the connection. The process also ends when its parent process ends."""
    end_with_parent()
    logging.disable(logging.CRITICAL)

    def on_time(time_s: float) -> None:
        shared_time.value = time_s

    ON_TIME.set(on_time)
    while True:
        try:
            sent = connection.recv_bytes()
        except (EOFError, OSError):
            return
        try:
            run, item = loads(sent)
            answer: tuple[Any, Exception | None] = run(item), None
        except Exception as error:
            answer = None, error
        connection.send(answer)
