"""ROS nodes and executors of a client process."""

import os
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from nodes.discovery import stay_on_this_machine
from nodes.namespace import namespace_arguments
from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors

Client = tuple[Node, SingleThreadedExecutor]
"""A node and its executor."""


@contextmanager
def client_node(name: str, namespace: str = "") -> Iterator[Client]:
    """Provide a node in a namespace, together with its executor, which the caller spins.

    The caller remains responsible for signal handling.

    Raises:
        RosError: ROS 2 does not start.
    """
    with client_nodes([name], namespace) as (client,):
        yield client


@contextmanager
def client_nodes(names: Sequence[str], namespace: str = "") -> Iterator[list[Client]]:
    """Provide several nodes, each with its own executor, for clients that use several threads.

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


class WatchingNode:
    """A node with its own thread and ROS context, for viewers that only watch."""

    def __init__(self, name: str, namespace: str) -> None:
        """Create the node in a namespace; empty for the root namespace. Add subscriptions, then call ``start``."""
        stay_on_this_machine(os.environ)
        self._context: Any = rclpy.Context()
        rclpy.init(args=namespace_arguments(namespace), context=self._context)
        self.node: Node = rclpy.create_node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)

    def start(self) -> None:
        """Start receiving messages."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and leave the ROS graph."""
        with exit_watchdog():
            self._executor.shutdown(timeout_sec=1.0)
            self._thread.join(1.0)
            self.node.destroy_node()
            self._context.try_shutdown()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()
