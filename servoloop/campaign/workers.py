"""Runs on several processes, told in the order of their seeds, however many processes there are."""

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from itertools import takewhile
from queue import SimpleQueue
from threading import Event
from typing import Final, TypeVar

from servoloop.campaign.quiet import quiet
from servoloop.campaign.supervised import Loss, Supervisor, deaf

T = TypeVar("T")
Run = Callable[[int], T]
"""The run of a seed."""
Lost = Callable[[int, Loss], T]
"""The result of a seed whose run was lost."""
Stop = Callable[[], bool]
"""Whether to end with what has been done."""
Submit = Callable[[range], Future[list[T]]]
"""Hands the seeds of one task to a worker."""

CHUNK: Final = 5
"""Runs that a worker takes at once."""
TASKS_AHEAD: Final = 4
"""Tasks for each worker that are handed out before the first of them is done: no report waits long for its turn."""
LOOK_S: Final = 0.1
"""Seconds after which whoever waits for a worker looks whether to stop."""


def run_all(supervisor: Supervisor, run: Run[T], lost: Lost[T], seeds: Iterable[int]) -> list[T]:
    """The task of a worker, in the supervisor's process."""
    return [_run_one(supervisor, run, lost, seed) for seed in seeds]


def _run_one(supervisor: Supervisor, run: Run[T], lost: Lost[T], seed: int) -> T:
    """Run a seed. If its process ends, it is run once more, in a new process: another program may have ended the first.

    A run that hangs is not run again.
    """
    result = supervisor.run(run, seed)
    if isinstance(result, Loss) and not result.hung:
        result = supervisor.run(run, seed)
    return lost(seed, result) if isinstance(result, Loss) else result


def in_order(submit: Submit[T], seeds: range, workers: int, stop: Stop) -> Generator[T, None, None]:
    """What the runs of all seeds return, in the order of the seeds, until ``stop``; a few tasks are kept at a time."""
    chunks = iter([seeds[at : at + CHUNK] for at in range(0, len(seeds), CHUNK)])
    waiting: deque[Future[list[T]]] = deque()
    while not stop():
        while len(waiting) < workers * TASKS_AHEAD and (chunk := next(chunks, None)) is not None:
            waiting.append(submit(chunk))
        if not waiting:
            return
        if wait([waiting[0]], LOOK_S).done:
            yield from waiting.popleft().result()


def in_this_process(run: Run[T], seeds: range, stop: Stop) -> Generator[T, None, None]:
    """The same without workers. A run that ends its process ends this one."""
    with quiet():
        for seed in seeds:
            if stop():
                return
            yield run(seed)


def in_processes(run: Run[T], lost: Lost[T], seeds: range, processes: int, stop: Stop) -> Generator[T, None, None]:
    """The same on several processes of this machine."""
    idle: SimpleQueue[Supervisor] = SimpleQueue()
    over = Event()
    """Set at the end, when no task begins another run."""
    for _ in range(processes):
        idle.put(Supervisor())

    def task(chunk: range) -> list[T]:
        supervisor = idle.get()
        try:
            return run_all(supervisor, run, lost, takewhile(lambda _: not over.is_set(), chunk))
        finally:
            idle.put(supervisor)

    def submit(chunk: range) -> Future[list[T]]:
        with deaf():
            return pool.submit(task, chunk)

    with ThreadPoolExecutor(processes) as pool:
        try:
            yield from in_order(submit, seeds, processes, stop)
        finally:
            over.set()
            pool.shutdown(cancel_futures=True)
            while not idle.empty():
                idle.get().close()
