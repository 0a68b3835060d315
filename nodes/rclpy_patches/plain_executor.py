"""The executor for an rclpy that cycle_executor.py does not know: rclpy's own, which is woken for each cycle."""

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node


class PlainExecutor(SingleThreadedExecutor):
    """Has the two methods that the surface uses of ``CycleExecutor``."""

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._posted = node.create_guard_condition(lambda: None)

    def post(self) -> None:
        """A cycle is done: ``serve`` comes back. For any thread; never waits."""
        self._posted.trigger()

    def serve(self, timeout_s: float, behind: bool = False) -> None:
        """Until one callback has run, that of a posted cycle included, or the time is over.

        ``behind`` changes nothing: clients are served in turn with the cycles.
        """
        self.spin_once(timeout_sec=timeout_s)
