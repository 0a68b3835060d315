"""The forward command controller's face: ``~/commands``."""

from builtin_interfaces.msg import Time
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from controller.forward_command_controller import ForwardCommandController


class ForwardNode:
    """One node named after its controller."""

    def __init__(self, controller: ForwardCommandController) -> None:
        self.node = Node(controller.name)
        self._controller = controller
        self.node.create_subscription(Float64MultiArray, "~/commands", self._on_command, 10)

    def publish(self, stamp: Time) -> None:
        """It has nothing to say."""

    def _on_command(self, message: Float64MultiArray) -> None:
        reason = self._controller.submit(list(message.data))
        if reason:
            self.node.get_logger().error(reason)
