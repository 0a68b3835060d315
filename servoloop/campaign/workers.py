"""Execute the runs of a campaign in one or more processes, and return the results in seed order."""

import logging
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from itertools import takewhile
from queue import SimpleQueue
from threading import Event
from typing import Final, TypeVar

from servoloop.campaign.supervised import Loss, Supervisor, blocked_signals

T = TypeVar("T")
Run = Callable[[int], T]
"""Function that executes the run of a seed and returns its result."""
Lost = Callable[[int, Loss], T]
"""Function that returns the result of a seed whose run was lost."""
Stop = Callable[[], bool]
"""Function that returns whether to stop and keep the results so far."""
Submit = Callable[[range], Future[list[T]]]
"""Function that hands the seeds of one task to a worker."""

CHUNK: Final = 5
"""Number of seeds in one task."""
TASKS_AHEAD: Final = 4
"""Number of tasks per worker that may be submitted before the oldest task is done, to limit the number of waiting
results."""
POLL_S: Final = 0.1
"""Interval at which ``stop`` is polled while a task is running, in seconds."""


@contextmanager
def quiet() -> Iterator[None]:
    """Disable all logging within the context, because thousands of arms log their faults."""
    former = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(former)


def run_all(supervisor: Supervisor, run: Run[T], lost: Lost[T], seeds: Iterable[int]) -> list[T]:
    """Execute one task: run its seeds in the process of this supervisor."""
    return [_run_one(supervisor, run, lost, seed) for seed in seeds]


def _run_one(supervisor: Supervisor, run: Run[T], lost: Lost[T], seed: int) -> T:
    """Run a seed.

    If a seed's process ends, run the seed once more, because another program may have killed the process. A run that
    hangs is not repeated.
    """
    result = supervisor.run(run, seed)
    if isinstance(result, Loss) and not result.hung:
        result = supervisor.run(run, seed)
    return lost(seed, result) if isinstance(result, Loss) else result


def in_order(submit: Submit[T], seeds: range, workers: int, stop: Stop) -> Generator[T, None, None]:
    """Yield the results of all seeds in seed order, until ``stop`` returns True."""
    chunks = (seeds[at : at + CHUNK] for at in range(0, len(seeds), CHUNK))
    waiting: deque[Future[list[T]]] = deque()
    while not stop():
        while len(waiting) < workers * TASKS_AHEAD and (chunk := next(chunks, None)) is not None:
            waiting.append(submit(chunk))
        if not waiting:
            return
        if wait([waiting[0]], POLL_S).done:
            yield from waiting.popleft().result()


def in_this_process(run: Run[T], seeds: range, stop: Stop) -> Generator[T, None, None]:
    """Run the seeds in this process and yield their results. Killing a run ends this process."""
    with quiet():
        for seed in seeds:
            if stop():
                return
            yield run(seed)


def in_processes(run: Run[T], lost: Lost[T], seeds: range, processes: int, stop: Stop) -> Generator[T, None, None]:
    """Run the seeds in several processes on this machine and yield their results in seed order."""
    idle: SimpleQueue[Supervisor] = SimpleQueue()
    over = Event()
    """Event that is set at the end, so that tasks do not start any more runs."""
    for _ in range(processes):
        idle.put(Supervisor())

    def task(chunk: range) -> list[T]:
        supervisor = idle.get()
        try:
            return run_all(supervisor, run, lost, takewhile(lambda _: not over.is_set(), chunk))
        finally:
            idle.put(supervisor)

    def submit(chunk: range) -> Future[list[T]]:
        with blocked_signals():
            return pool.submit(task, chunk)

    with ThreadPoolExecutor(processes) as pool:
        try:
            yield from in_order(submit, seeds, processes, stop)
        finally:
            over.set()
            pool.shutdown(cancel_futures=True)
            while not idle.empty():
                idle.get().close()
