"""A client whose calls block the ROS thread of the stack, because it cannot receive responses."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from controller_manager_msgs.srv import ListControllers
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile


@contextmanager
def deaf_client(node: Node) -> Iterator[Callable[[], object]]:
    """Provide a service call with an incompatible QoS, for whose response the middleware waits 0.1 s (two cycles)."""
    qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    deaf = node.create_client(ListControllers, "/controller_manager/list_controllers", qos_profile=qos)
    yield lambda: deaf.call_async(ListControllers.Request())
    node.destroy_client(deaf)
