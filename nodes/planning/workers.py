"""Threads that compute for the callbacks of an executor, so that no request waits for the computation of another."""

from collections.abc import Callable
from concurrent.futures import Future as ThreadFuture
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

from rclpy.node import Node
from rclpy.task import Future

COMPUTING: Final = 3
"""Number of threads for everything except searches."""

Answer = TypeVar("Answer")


class Workers:
    """One thread for searches, because OMPL's random generator is global, and several for other computations."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._search = ThreadPoolExecutor(1, "search")
        self._compute = ThreadPoolExecutor(COMPUTING, "compute")

    async def search(self, work: Callable[[], Answer]) -> Answer:
        """Run a search after those that wait, and return its result."""
        return await self._run(self._search, work)

    async def compute(self, work: Callable[[], Answer]) -> Answer:
        """Run another computation, and return its result."""
        return await self._run(self._compute, work)

    def close(self) -> None:
        """Forget the work that has not begun. Searches that are running end when their time is over."""
        self._search.shutdown(wait=False, cancel_futures=True)
        self._compute.shutdown(wait=False, cancel_futures=True)

    async def _run(self, pool: ThreadPoolExecutor, work: Callable[[], Answer]) -> Answer:
        done, executor = Future(), self._node.executor
        running: ThreadFuture[Answer] = pool.submit(work)
        running.add_done_callback(lambda _: executor.create_task(done.set_result, None))
        await done
        return running.result()
