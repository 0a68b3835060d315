"""Waiting with a time-out in a callback of a single-threaded executor, without blocking it."""

from collections.abc import Callable
from typing import Any, Final

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future

GONE_S: Final = 2.0
"""So long a server is off the graph before its motion is given up."""
_LOOK_S: Final = 0.5


class Waiter:
    """Answers of programs are waited for on the steady clock: a simulated clock that stands still must not stop that.

    Motions take their time on the node's clock where that is simulated. That clock may stand still for ever when the
    simulation has ended, so that a motion is given up when its server is gone.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    async def until(self, timeout_s: float, *futures: Future) -> bool:
        """True once one of the futures is done, at once or within ``timeout_s``."""
        return await self._until(timeout_s, self._steady, *futures)

    async def until_moved(self, timeout_s: float, there: Callable[[], bool], *futures: Future) -> bool:
        """The same for what takes as long as a motion does, and while the server is ``there``."""
        clock, gone, absent = self._node.get_clock(), Future(), 0

        def look() -> None:
            nonlocal absent
            absent = 0 if there() else absent + 1
            if absent * _LOOK_S >= GONE_S and not gone.done():
                gone.set_result(None)

        timer = self._node.create_timer(_LOOK_S, look, clock=self._steady)
        try:
            await self._until(timeout_s, clock if clock.ros_time_is_active else self._steady, gone, *futures)
        finally:
            self._node.destroy_timer(timer)
        return any(future.done() for future in futures)

    async def _until(self, timeout_s: float, clock: Clock, *futures: Future) -> bool:
        bell = Future()

        def ring(_: Any = None) -> None:
            if not bell.done():
                bell.set_result(None)
                self.wake()

        timer = self._node.create_timer(timeout_s, ring, clock=clock)
        for future in futures:
            future.add_done_callback(ring)
        try:
            await bell
        finally:
            self._node.destroy_timer(timer)
            for future in futures:
                future.remove_done_callback(ring)
        return any(future.done() for future in futures)

    def wake(self) -> None:
        """Let the executor look at its tasks again.

        rclpy resumes a task that awaits a future only on its next round, and it may have looked at
        that task before the future was set.
        """
        if self._node.executor is not None:
            self._node.executor.wake()
