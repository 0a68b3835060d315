"""Executor for rclpy versions that cycle_executor.py does not support. It wakes rclpy's executor for each cycle."""

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node


class PlainExecutor(SingleThreadedExecutor):
    """rclpy's executor with the methods ``post`` and ``serve`` of ``CycleExecutor``."""

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._posted = node.create_guard_condition(lambda: None)

    def post(self) -> None:
        """Make ``serve`` return because a cycle is complete. Thread-safe and non-blocking."""
        self._posted.trigger()

    def serve(self, timeout_s: float, behind: bool = False) -> None:
        """Serve until one callback has run or the timeout has passed. A posted cycle counts as a callback.

        ``behind`` has no effect, because clients and cycles are served in turn.
        """
        self.spin_once(timeout_sec=timeout_s)
