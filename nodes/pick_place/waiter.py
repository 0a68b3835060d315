"""Wait with a timeout in a callback of a single-threaded executor, without blocking the executor."""

from collections.abc import Callable
from typing import Any, Final

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future

GONE_S: Final = 2.0
"""Minimum time a server must be missing from the graph before the wait for its motion ends, in seconds."""
_CHECK_S: Final = 0.5
_POLL_S: Final = 0.05


class Waiter:
    """Helper that waits for futures with a timeout.

    Responses are awaited on the steady clock, so that a paused simulation cannot block the wait.

    In a simulation, motions are timed by the node's clock. The simulated clock stops when the simulation ends. The wait
    for a motion therefore also ends when its server has disappeared.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    async def until(self, timeout_s: float, *futures: Future) -> bool:
        """Wait up to ``timeout_s`` for one of the futures, and return whether one is done."""
        return await self._until(timeout_s, self._steady, *futures)

    async def until_ready(self, timeout_s: float, ready: Callable[[], bool], stop: Future) -> bool:
        """Wait up to ``timeout_s`` until ``ready`` returns true, and return the last value that it returned. Use this
        method before a request, because a request to a server that is not connected yet is lost. The wait also ends
        when ``stop`` is done.
        """
        for _ in range(round(timeout_s / _POLL_S)):
            if ready() or stop.done():
                break
            await self.until(_POLL_S, stop)
        return ready()

    async def until_moved(self, timeout_s: float, available: Callable[[], bool], *futures: Future) -> bool:
        """Wait like ``until`` for a motion to end, but use the node's clock if time is simulated, and stop waiting when
        the server disappears."""
        clock, gone, absent = self._node.get_clock(), Future(), 0

        def check_server() -> None:
            nonlocal absent
            absent = 0 if available() else absent + 1
            if absent * _CHECK_S >= GONE_S and not gone.done():
                gone.set_result(None)

        timer = self._node.create_timer(_CHECK_S, check_server, clock=self._steady)
        try:
            await self._until(timeout_s, clock if clock.ros_time_is_active else self._steady, gone, *futures)
        finally:
            self._node.destroy_timer(timer)
        return any(future.done() for future in futures)

    async def _until(self, timeout_s: float, clock: Clock, *futures: Future) -> bool:
        finished = Future()

        def finish(_: Any = None) -> None:
            if not finished.done():
                finished.set_result(None)
                self.wake()

        timer = self._node.create_timer(timeout_s, finish, clock=clock)
        for future in futures:
            future.add_done_callback(finish)
        try:
            await finished
        finally:
            self._node.destroy_timer(timer)
            for future in futures:
                future.remove_done_callback(finish)
        return any(future.done() for future in futures)

    def wake(self) -> None:
        """Make the executor check its tasks again.

        rclpy resumes a waiting task only in its next iteration, and it may have checked the task before the task's
        future was done.
        """
        if self._node.executor is not None:
            self._node.executor.wake()
