"""Child processes: started, watched, ended in the opposite order, their words kept. None outlives this process."""

import ctypes
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import psutil

from drivers.clock import MonotonicClock
from drivers.errors import DriverError

END_S: Final = 60.0
"""The longest that a process may take to end: the emulator draws its pictures then."""
LOOK_S: Final = 0.02
_PR_SET_PDEATHSIG: Final = 1
LOG = logging.getLogger("servoloop")


class Interrupted(Exception):
    """The user has ended the program by a signal."""


def end_with_parent() -> None:
    """A child process calls this before ``exec``, to get SIGTERM when this process ends, however that ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def end(process: "subprocess.Popen[Any]", timeout_s: float = END_S, hurry: Callable[[], bool] = lambda: False) -> int:
    """End a process; its exit status. One that does not end in time, or when ``hurry`` becomes true, is killed."""
    clock = MonotonicClock()
    deadline_s = clock.now() + timeout_s
    process.terminate()
    process.send_signal(signal.SIGCONT)  # one that was stopped hears nothing until it goes on
    while process.poll() is None:
        if hurry() or clock.now() > deadline_s:
            LOG.warning("process %d does not end: it is killed", process.pid)
            process.kill()
            return process.wait()
        clock.sleep_until(clock.now() + LOOK_S)
    return process.returncode


class Processes:
    """Processes runs child processes within its context. What a process prints goes to ``folder``/NAME.log.

    ``signals`` tells how many signals there were: the first ends every wait with Interrupted, a second one kills.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str], signals: Callable[[], int] = lambda: 0) -> None:
        self._folder = folder
        self._environment = dict(environment)
        self._signals = signals
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []

    def start(self, name: str, module: str, *arguments: str) -> int:
        """Start ``python -m module arguments``; returns the process ID."""
        with (self._folder / f"{name}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=self._environment,
                start_new_session=True,  # Ctrl-C reaches this process, which ends them in order
                preexec_fn=end_with_parent,
            )
        self._running.append((name, process))
        return process.pid

    def check(self) -> None:
        """Raise DriverError with the last words of a process that has ended by itself."""
        for name, process in self._running:
            if process.poll() is not None:
                lines = (self._folder / f"{name}.log").read_text(errors="replace").splitlines()
                words = "\n  ".join(lines[-12:])
                raise DriverError(f"{name} ended (status {process.returncode}):\n  {words}")

    def wait_until(self, ready: Callable[[], bool], what: str, timeout_s: float) -> None:
        """Wait for a condition while all processes live. Raises DriverError, or Interrupted after a signal."""
        clock = MonotonicClock()
        deadline_s = clock.now() + timeout_s
        while not ready():
            self.check()
            if self._signals():
                raise Interrupted(f"interrupted while {what}")
            if clock.now() > deadline_s:
                raise DriverError(f"{what} took longer than {timeout_s:.0f} s: the logs are in {self._folder}")
            clock.sleep_until(clock.now() + LOOK_S)

    def end(self) -> dict[str, int]:
        """End all processes, the last started first; returns their exit statuses."""
        statuses: dict[str, int] = {}
        while self._running:
            name, process = self._running.pop()
            statuses[name] = end(process, hurry=lambda: self._signals() > 1)
        return statuses

    def __enter__(self) -> "Processes":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()


PRIORITY = 10
LOOP_PRIORITY = 11


def claim_realtime_priority(priority: int = PRIORITY) -> bool:
    """Claim real-time priority for this process; whether it was granted. Threads that are there already stay as
    they are, so it comes before ROS, whose middleware has its own.

    The whole process and not one thread: a thread of high priority that waits for the interpreter's lock, or for
    the middleware's, is only as fast as the thread that holds it.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    except PermissionError:
        LOG.info("no real-time priority (a limit 'rtprio' of %d would allow it): ordinary timing", LOOP_PRIORITY)
        return False
    return True


@contextmanager
def realtime_priority() -> Iterator[None]:
    """Have a loop's real-time priority where the system grants it, and what was there before afterwards; ordinary
    priority where that was more than the system grants now.

    For a program that computes long before or behind what it does in real time: at this priority it would keep the
    loops of other programs from the processor for as long. At ``PRIORITY`` it would share the processor with
    stacks that are starting, in turns of 0.1 s each, and servos that answer so late count as lost.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    claim_realtime_priority(LOOP_PRIORITY)
    try:
        yield
    finally:
        try:
            os.sched_setscheduler(0, *before)
        except PermissionError:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def at_ordinary_priority() -> None:
    """Give up the real-time priority that this process has inherited."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def put_first() -> None:
    """Let the calling thread run before the others of this process, where the process has real-time priority."""
    if os.sched_getscheduler(0) != os.SCHED_RR:
        return
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(LOOP_PRIORITY))
    except PermissionError:
        LOG.info("the control loop has no priority over this process' other threads (rtprio %d)", LOOP_PRIORITY)


@contextmanager
def on_one_processor() -> Iterator[None]:
    """Keep the main thread, which calls this, on the processor on which it is, and whatever it starts meanwhile.

    For a loop of ordinary priority that does nothing but wait for a line. The system wakes it wherever there is
    room, in every other cycle on another processor, whose caches know nothing of it. Not for a loop with other
    threads beside it: it may have to wait for its one processor while another is free.
    """
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {psutil.Process().cpu_num()})
    except OSError as error:
        LOG.info("the loop may be moved from one processor to another: %s", error)
        yield
        return
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
