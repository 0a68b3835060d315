"""A client process' share of ROS: one node, one executor, and their end."""

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from nodes.leaving import leaving


@contextmanager
def client_session(name: str) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """A node of that name on an executor that the caller spins. Signals stay the caller's."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Node(name)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        with leaving():
            executor.shutdown(timeout_sec=1.0)
            node.destroy_node()
            rclpy.try_shutdown()
