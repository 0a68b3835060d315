"""Run child processes and set real-time priorities. Child processes never outlive this process."""

import ctypes
import gc
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import psutil

from drivers.clock import MonotonicClock
from drivers.driver_errors import DriverError

END_S: Final = 60.0
"""Maximum time for a process to end, in seconds. The emulator renders its images before it exits."""
POLL_S: Final = 0.02
"""Interval between checks while waiting for a process, in seconds."""
_PR_SET_PDEATHSIG: Final = 1
LOG = logging.getLogger("servoloop")


class Interrupted(Exception):
    """Raised when the user has ended the program with a signal."""


def choose_ros_domain() -> None:
    """Set a separate ROS domain for this process and its children, unless the user has set one."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))


def end_with_parent() -> None:
    """Request that the calling process receive SIGTERM when its parent exits. A child process calls this before
    ``exec``."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def start_child(command: Sequence[str], **options: Any) -> "subprocess.Popen[bytes]":
    """Start a process that receives SIGTERM when this program ends. ``options`` are those of ``subprocess.Popen``.

    The system sends the signal when the thread that started the process ends. The calling thread may end early, so
    another thread starts the process and waits for its end.
    """
    started: Future[subprocess.Popen[bytes]] = Future()

    def run() -> None:
        try:
            process = subprocess.Popen(command, preexec_fn=end_with_parent, **options)
        except BaseException as error:
            started.set_exception(error)
        else:
            started.set_result(process)
            process.wait()

    threading.Thread(target=run, name="child process", daemon=True).start()
    return started.result()


def end(process: "subprocess.Popen[Any]", timeout_s: float = END_S, hurry: Callable[[], bool] = lambda: False) -> int:
    """End a process and return its exit status.

    Kill the process after the timeout or as soon as ``hurry`` returns true.
    """
    clock = MonotonicClock()
    deadline_s = clock.now() + timeout_s
    process.terminate()
    process.send_signal(signal.SIGCONT)  # a stopped process handles SIGTERM only after it is resumed
    while process.poll() is None:
        if hurry() or clock.now() > deadline_s:
            LOG.warning("process %d did not end and was killed", process.pid)
            process.kill()
            return process.wait()
        clock.sleep_until(clock.now() + POLL_S)
    return process.returncode


class Processes:
    """Child processes that run within a context. The output of each process is written to ``folder``/NAME.log.

    ``signals`` returns the number of signals received so far. The first signal interrupts every wait; the second signal
    kills the processes.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str], signals: Callable[[], int] = lambda: 0) -> None:
        self._folder = folder
        self._environment = dict(environment)
        self._signals = signals
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []

    def start(self, name: str, module: str, *arguments: str) -> int:
        """Start ``python -m module arguments`` and return the process ID."""
        with (self._folder / f"{name}.log").open("wb") as log:
            process = start_child(
                [sys.executable, "-m", module, *arguments],
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=self._environment,
                start_new_session=True,  # Ctrl-C must reach only this process, which ends its children in order
            )
        self._running.append((name, process))
        return process.pid

    def check(self) -> None:
        """Raise DriverError with the last lines of a process's output if that process has ended."""
        for name, process in self._running:
            if process.poll() is not None:
                lines = (self._folder / f"{name}.log").read_text(errors="replace").splitlines()
                output = "\n  ".join(lines[-12:])
                raise DriverError(f"{name} ended unexpectedly (exit status {process.returncode}):\n  {output}")

    def wait_until(self, ready: Callable[[], bool], action: str, timeout_s: float) -> None:
        """Wait for a condition. ``action`` describes in messages what the program is waiting for, such as "starting the
        stack".

        Raises:
            DriverError: A process has ended, or the timeout has expired.
            Interrupted: A signal has arrived.
        """
        clock = MonotonicClock()
        deadline_s = clock.now() + timeout_s
        while not ready():
            self.check()
            if self._signals():
                raise Interrupted(f"interrupted while {action}")
            if clock.now() > deadline_s:
                raise DriverError(f"{action} took longer than {timeout_s:.0f} s: see the logs in {self._folder}")
            clock.sleep_until(clock.now() + POLL_S)

    def end(self) -> dict[str, int]:
        """End all processes in reverse start order, and return their exit statuses."""
        statuses: dict[str, int] = {}
        while self._running:
            name, process = self._running.pop()
            statuses[name] = end(process, hurry=lambda: self._signals() > 1)
        return statuses

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


PRIORITY = 10
LOOP_PRIORITY = 11
NEW_OBJECTS = 300
"""Number of new objects that the garbage collector examines at once. A collection takes about 0.2 ms."""
NEVER = 2**31 - 1
"""Number of partial collections before a full collection. This is the largest number that Python accepts."""


def claim_realtime_priority(priority: int = PRIORITY) -> bool:
    """Request real-time priority for this process, and return whether it was granted.

    Existing threads keep their priority, so call this before ROS starts its middleware threads. The whole process needs
    the priority, because a high-priority thread often waits for a lock that another thread holds.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    except PermissionError:
        LOG.info("running without real-time priority: to allow it, set the limit 'rtprio' to %d", LOOP_PRIORITY)
        return False
    return True


@contextmanager
def realtime_priority(priority: int = LOOP_PRIORITY) -> Iterator[None]:
    """Run with a real-time priority, if the system grants it, for the duration of the context.

    Afterward, restore the previous priority; if the system does not grant it, use ordinary priority. Use this context
    for programs with long computations before or after their real-time part. If they ran at real-time priority, these
    computations would block the loops of other programs. Threads that start in the context keep its priority.

    Do not pass ``PRIORITY`` if the real-time part runs in the calling thread. Otherwise, the program and any stack that
    is starting would take turns on the processor, in time slices of 0.1 s. Servos would count as lost, because their
    replies would be read up to 0.1 s late.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    claim_realtime_priority(priority)
    try:
        yield
    finally:
        try:
            os.sched_setscheduler(0, *before)
        except PermissionError:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def at_ordinary_priority() -> None:
    """Give up the real-time priority inherited from the parent process."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextmanager
def prompt_interpreter(full_collections: bool = False) -> Iterator[None]:
    """Keep other Python threads and the garbage collector from delaying the control loop for the duration of the
    context.

    A full collection would delay a loop at 200 Hz by 35 ms, because each cycle creates objects that are kept for fault
    files. The collector therefore examines only new objects, in small groups. Reference cycles of older objects are
    not found, but the stack creates very few: a full collection after 60 goals found 40 objects.

    Args:
        full_collections: Whether full collections continue. Programs of users need these collections, because their
            reference cycles may be large.
    """
    sys.setswitchinterval(0.0001)  # maximum time the loop waits for the interpreter lock, in seconds
    thresholds = gc.get_threshold()
    gc.collect()
    gc.freeze()
    if not full_collections:
        gc.set_threshold(NEW_OBJECTS, 1, NEVER)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)
        gc.unfreeze()


def put_first() -> None:
    """Raise the calling thread's priority above the other threads of this process, if the process has real-time
    priority."""
    if os.sched_getscheduler(0) != os.SCHED_RR:
        return
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(LOOP_PRIORITY))
    except PermissionError:
        LOG.info("the control loop runs without priority over the other threads: set 'rtprio' to %d", LOOP_PRIORITY)


@contextmanager
def on_one_processor() -> Iterator[None]:
    """Pin the main thread, and the processes it starts, to the current processor. Call this function in the main
    thread.

    Use this context for a loop of ordinary priority that only waits for a bus. Otherwise, the system often moves the
    loop to another processor, with cold caches. Do not use this context for a loop with additional threads, because
    they might have to wait even when another processor is free.
    """
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {psutil.Process().cpu_num()})
    except OSError as error:
        LOG.info("the loop cannot be pinned to one processor: %s", error)
        yield
        return
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
