"""ROS node and executor of a client process."""

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors


@contextmanager
def client_node(name: str, namespace: str = "") -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """Provide a node in a namespace and its executor, which the caller spins.

    Signal handling remains with the caller.

    Raises:
        RosError: ROS 2 does not start.
    """
    init_rclpy(namespace=namespace)
    with rcl_errors():
        node = Node(name)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        with exit_watchdog():
            executor.shutdown(timeout_sec=1.0)
            node.destroy_node()
            rclpy.try_shutdown()
