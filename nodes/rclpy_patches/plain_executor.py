"""Executor for rclpy versions that cycle_executor.py does not support. This is rclpy's own executor."""

from contextlib import AbstractContextManager

from rclpy.executors import ConditionReachedException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node


class PlainExecutor(SingleThreadedExecutor):
    """rclpy's executor, extended with the methods ``post`` and ``serve`` of ``CycleExecutor``."""

    def __init__(self, node: Node, turn: AbstractContextManager[object]) -> None:
        super().__init__()
        self._turn = turn
        self._posted = node.create_guard_condition(lambda: None)

    def post(self) -> None:
        """Make ``serve`` return because a client expects an answer. This method is thread-safe and does not block."""
        self._posted.trigger()

    def serve(self, timeout_s: float) -> None:
        """Serve until one callback has run or the timeout has passed. Exceptions propagate."""
        try:
            handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=timeout_s)
        except (ShutdownException, TimeoutException, ConditionReachedException):
            return
        with self._turn:
            handler()
        handler.result()  # Raise the callback's exception, if any.
