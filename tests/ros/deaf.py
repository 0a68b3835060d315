"""A client that cannot hear: its calls hold up the ROS side of the stack."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from controller_manager_msgs.srv import ListControllers
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile


@contextmanager
def deaf_client(node: Node) -> Iterator[Callable[[], object]]:
    """A call for the answer to which the middleware waits 0.1 s, two cycles long: no ear fits it."""
    qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    deaf = node.create_client(ListControllers, "/controller_manager/list_controllers", qos_profile=qos)
    yield lambda: deaf.call_async(ListControllers.Request())
    node.destroy_client(deaf)
