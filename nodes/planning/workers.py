"""Threads that compute for the callbacks of an executor, so that requests do not wait for each other."""

from collections.abc import Callable
from concurrent.futures import Future as ThreadFuture
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

from rclpy.node import Node
from rclpy.task import Future

COMPUTING: Final = 3
"""Number of threads for all computations except searches."""

Answer = TypeVar("Answer")


class Workers:
    """Worker threads. Searches share one thread, because OMPL's random number generator is global.

    Other computations use several threads.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._search = ThreadPoolExecutor(1, "search")
        self._compute = ThreadPoolExecutor(COMPUTING, "compute")

    async def search(self, work: Callable[[], Answer]) -> Answer:
        """Run a search after the searches that are already queued, and return its result."""
        return await self._run(self._search, work)

    async def compute(self, work: Callable[[], Answer]) -> Answer:
        """Run a computation other than a search, and return its result."""
        return await self._run(self._compute, work)

    def close(self) -> None:
        """Discard queued work that has not started. Searches that are already running end when they reach their time
        limit."""
        self._search.shutdown(wait=False, cancel_futures=True)
        self._compute.shutdown(wait=False, cancel_futures=True)

    async def _run(self, pool: ThreadPoolExecutor, work: Callable[[], Answer]) -> Answer:
        done, executor = Future(), self._node.executor
        running: ThreadFuture[Answer] = pool.submit(work)
        running.add_done_callback(lambda _: executor.create_task(done.set_result, None))
        await done
        return running.result()
