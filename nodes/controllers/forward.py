"""Receive the commands of the forward command controllers on ``~/commands``."""

from typing import Protocol

from builtin_interfaces.msg import Time
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from drivers.printable import printable
from nodes.publishing import ANY_CLIENT


class TakesCommands(Protocol):
    """A forward command controller with any type of command interface."""

    def submit(self, values: list[float]) -> str | None:
        """Submit a command. Return the reason why the command was dropped, or None if it was accepted."""
        ...


class ForwardNode:
    """Interface node of a forward command controller."""

    def __init__(self, node: Node, controller: TakesCommands) -> None:
        self.node = node
        self._controller = controller
        self.node.create_subscription(Float64MultiArray, "~/commands", self._on_command, ANY_CLIENT)

    def publish(self, stamp: Time) -> None:
        """Do nothing, because a forward command controller does not publish any topics."""

    def _on_command(self, message: Float64MultiArray) -> None:
        reason = self._controller.submit(list(message.data))
        if reason:
            self.node.get_logger().error(printable(reason))
