"""Start rclpy with the patches for this rclpy version, and keep serving nodes even if a callback fails."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Final

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from nodes.rclpy_patches import cycle_executor, gil_release
from nodes.rclpy_patches.guard import usable_patches
from nodes.rclpy_patches.plain_executor import PlainExecutor
from nodes.ros_process import init_rclpy

FINISH_S: Final = 0.2
"""Time for which clients are still served after the control loop has stopped, in seconds."""
WAKE_S: Final = 0.1
"""Interval at which the executor wakes to send delayed responses and check whether to stop, in seconds."""

LOG = logging.getLogger("servoloop.nodes")

CycleExecutor = cycle_executor.CycleExecutor | PlainExecutor


def start_rclpy(namespace: str) -> Callable[[], None]:
    """Initialize rclpy with all nodes in a namespace, and return the function that sends delayed responses."""
    patched = gil_release.PATCH in usable_patches()
    if patched:
        gil_release.release_gil_in_middleware()
    LOG.info("%s", init_rclpy(namespace=namespace))
    return gil_release.send_delayed if patched else lambda: None


def executor_of(node: Node, turn: AbstractContextManager[object]) -> CycleExecutor:
    """Create the executor for ``node`` and for nodes that are added later. The executor holds ``turn`` while callbacks
    run."""
    supported = cycle_executor.PATCH in usable_patches()
    return cycle_executor.CycleExecutor(turn) if supported else PlainExecutor(node, turn)


def serve(stop: Callable[[], bool], steps: Sequence[Callable[[], object]]) -> None:
    """Run the steps in turn until ``stop`` returns True or rclpy shuts down. Errors in a step are logged."""
    while not stop() and rclpy.ok():
        try:
            for step in steps:
                with errors_logged():
                    step()
        except ExternalShutdownException:
            return


@contextmanager
def errors_logged() -> Iterator[None]:
    """Log errors instead of raising them, so that one client's unusual request does not interrupt the service for other
    clients."""
    try:
        yield
    except ExternalShutdownException:
        raise
    except Exception:
        LOG.exception("Error in a ROS callback")
