"""A process for runs, and its supervisor, which takes a new one when a run ends it or hangs."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.sharedctypes import RawValue
from pickle import loads
from typing import Any, Final, TypeVar

from drivers.errors import DriverError
from servoloop.campaign import hangs
from servoloop.campaign.hangs import SHOWN, Standstill, stands
from servoloop.campaign.quiet import silence
from servoloop.stack.processes import end_with_parent

T = TypeVar("T")
Item = TypeVar("Item")

RUNS_OF_A_PROCESS: Final = 100
"""A new process every so often gives back what its stacks have left behind: some 200 MB after a hundred runs."""
GRACE_S: Final = 30.0
"""Time for which a process may still end a run by itself whose simulated time stands still, and go on."""
ENDS_S: Final = 5.0
"""Time that an idle process may take to end."""
CONTEXT: Final = get_context("spawn")
CHILDREN: Final = threading.Lock()
"""One thread at a time starts a process or collects one: multiprocessing collects those of other threads, too."""


class WorkerError(DriverError):
    """Workers are killed again and again, or cannot be started."""


@dataclass(frozen=True, slots=True)
class Loss:
    """A run without a result: its process had to be killed because it hung, or it ended."""

    hung: bool
    time_s: float
    """Simulated time of the run."""
    text: str


class Supervisor:
    """Has runs done in a process of its own. ``close`` ends it."""

    def __init__(self) -> None:
        self._process: SpawnProcess | None = None
        self._connection: Connection | None = None
        self._shown: Any = None
        """The simulated time of the run under way, which the process writes."""
        self._done = 0

    def run(self, run: Callable[[Item], T], item: Item) -> T | Loss:
        """Do one run. Raises what it raises, and WorkerError if no process can be started."""
        if self._process is None or self._done >= RUNS_OF_A_PROCESS:
            self._renew()
        self._done += 1
        self._shown.value = 0.0
        assert self._connection is not None
        try:
            self._connection.send((run, item))
            if self._hangs():
                return self._lose(stands(self._shown.value))
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
        """Wait for the result; whether none comes because the simulated time stands still."""
        assert self._connection is not None
        standstill = Standstill(GRACE_S)
        while not self._connection.poll(hangs.LOOK_S):
            if standstill.look(self._shown.value):
                return True
        return False

    def _renew(self) -> None:
        self.close()
        self._connection, its_own = Pipe()
        self._shown, self._done = RawValue("d", 0.0), 0
        process = CONTEXT.Process(target=_work, args=(its_own, self._shown), daemon=True)
        try:
            with CHILDREN, deaf():
                process.start()
        except OSError as error:
            raise WorkerError(f"no process can be started: {error}: take fewer, with --jobs") from None
        its_own.close()
        self._process = process

    def _lose(self, hang: str = "") -> Loss:
        """Collect the process that has ended, or that is killed because of ``hang``."""
        assert self._process is not None
        if hang:
            self._process.kill()
        status = self._collect(self._process)
        return Loss(bool(hang), self._shown.value, hang or f"its process {_ending(status)}")

    def _collect(self, process: SpawnProcess) -> int | None:
        """Wait for a process that ends by itself, or kill it; its exit status."""
        wait([process.sentinel], ENDS_S)
        with CHILDREN:
            process.kill()
            process.join()
        self._process = None
        return process.exitcode


def _ending(status: int | None) -> str:
    """How a process ended, from its exit status."""
    if status is None or status >= 0:
        return f"ended with status {status}"
    name = next((one.name for one in signal.Signals if one == -status), f"signal {-status}")
    return f"was ended by {name}"


@contextmanager
def deaf() -> Iterator[None]:
    """Threads and processes that start in the body never hear of Ctrl-C and a closed terminal."""
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


def _work(connection: Connection, shown: Any) -> None:
    """Do runs as long as the supervisor sends some; the process ends with it, however that ends."""
    end_with_parent()
    silence()

    def show(time_s: float) -> None:
        shown.value = time_s

    SHOWN.set(show)
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
