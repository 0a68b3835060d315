"""The ROS interface of the forward command controllers: ``~/commands``."""

from typing import Protocol

from builtin_interfaces.msg import Time
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from drivers.printable import printable
from nodes.publishing import ANY_CLIENT


class TakesCommands(Protocol):
    """A forward command controller of whatever interface."""

    def submit(self, values: list[float]) -> str | None:
        """Returns why the command is dropped, or None."""
        ...


class ForwardNode:
    """On the node of its controller."""

    def __init__(self, node: Node, controller: TakesCommands) -> None:
        self.node = node
        self._controller = controller
        self.node.create_subscription(Float64MultiArray, "~/commands", self._on_command, ANY_CLIENT)

    def publish(self, stamp: Time) -> None:
        """There is nothing to publish."""

    def _on_command(self, message: Float64MultiArray) -> None:
        reason = self._controller.submit(list(message.data))
        if reason:
            self.node.get_logger().error(printable(reason))
