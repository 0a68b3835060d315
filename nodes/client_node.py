"""ROS nodes and executors of a client process."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors

Client = tuple[Node, SingleThreadedExecutor]
"""A node and its executor."""


@contextmanager
def client_node(name: str, namespace: str = "") -> Iterator[Client]:
    """Provide a node in a namespace and its executor, which the caller spins.

    Signal handling remains with the caller.

    Raises:
        RosError: ROS 2 does not start.
    """
    with client_nodes([name], namespace) as (client,):
        yield client


@contextmanager
def client_nodes(names: Sequence[str], namespace: str = "") -> Iterator[list[Client]]:
    """Provide several nodes, each with an executor of its own, for clients that run in several threads.

    Raises:
        RosError: ROS 2 does not start.
    """
    init_rclpy(namespace=namespace)
    with rcl_errors():
        clients = [(Node(name), SingleThreadedExecutor()) for name in names]
    for node, executor in clients:
        executor.add_node(node)
    try:
        yield clients
    finally:
        with exit_watchdog():
            for node, executor in clients:
                executor.shutdown(timeout_sec=1.0)
                node.destroy_node()
            rclpy.try_shutdown()
