"""Runs on several processes, told in the order of their seeds, however many processes there are."""

import logging
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import connection, get_context, parent_process
from typing import Final, TypeVar

from drivers.errors import DriverError

T = TypeVar("T")
Run = Callable[[int], T]
"""The run of a seed."""
Stop = Callable[[], bool]
"""Whether to end with what has been done."""
Submit = Callable[[range], Future[list[T]]]
"""Hands the seeds of one task to a worker."""

CHUNK: Final = 5
"""Runs that a worker takes at once."""
TASKS_OF_A_WORKER: Final = 20
"""A new process every so often gives back what its stacks have left behind: some 200 MB after a hundred runs."""
TASKS_AHEAD: Final = 4
"""Tasks for each worker that are handed out before the first of them is done: no report waits long for its turn."""
LOOK_S: Final = 0.1
"""Seconds after which whoever waits for a worker looks whether to stop."""


class WorkerError(DriverError):
    """A worker was killed in the middle of its runs, again and again."""


def run_all(run: Run[T], seeds: range) -> list[T]:
    """The task of a worker."""
    return [run(seed) for seed in seeds]


def in_order(submit: Submit[T], seeds: range, workers: int, stop: Stop) -> Iterator[T]:
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


def in_this_process(run: Run[T], seeds: range, stop: Stop) -> Iterator[T]:
    """The same without workers."""
    with quiet():
        for seed in seeds:
            if stop():
                return
            yield run(seed)


def in_processes(run: Run[T], seeds: range, processes: int, stop: Stop) -> Iterator[T]:
    """The same on several processes of this machine. Raises WorkerError where one is killed."""
    task = partial(run_all, run)
    context = get_context("spawn")
    with ProcessPoolExecutor(processes, context, _begin, max_tasks_per_child=TASKS_OF_A_WORKER) as pool:
        try:
            yield from in_order(lambda chunk: _submit(pool, task, chunk), seeds, processes, stop)
        except BrokenProcessPool:
            raise WorkerError(
                "a process of the campaign was killed, perhaps for want of memory: take fewer, with --jobs"
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def quiet() -> Iterator[None]:
    """Nothing is logged while the context lasts."""
    former = logging.root.manager.disable
    silence()
    try:
        yield
    finally:
        logging.disable(former)


def silence() -> None:
    """What thousands of arms log about their faults is nobody's concern."""
    logging.disable(logging.CRITICAL)


def _submit(pool: ProcessPoolExecutor, task: Callable[[range], list[T]], chunk: range) -> Future[list[T]]:
    """Ctrl-C and a closed terminal are not for the workers, nor while they start: what this starts, threads and
    processes, never hears of it."""
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        return pool.submit(task, chunk)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


def _begin() -> None:
    """A worker's first deed; it ends with the process that started it, however that ends."""
    silence()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
