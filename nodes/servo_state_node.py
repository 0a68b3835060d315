"""The servo state broadcaster's face: ``~/dynamic_joint_states``."""

from builtin_interfaces.msg import Time
from rclpy.node import Node

from controller.servo_state_broadcaster import ServoStateBroadcaster
from hal.types import JointState
from nodes.dynamic_states import DynamicStates


class ServoStateNode:
    """On the node of its controller. ``publish`` runs after each cycle, and passes on what is new."""

    def __init__(self, node: Node, controller: ServoStateBroadcaster) -> None:
        self.node = node
        self._controller = controller
        self._states = DynamicStates(node, "~/dynamic_joint_states", controller)
        self._shown: JointState | None = None

    def publish(self, stamp: Time) -> None:
        """The state that is due, if it is."""
        state = self._controller.state
        if state is not None and state is not self._shown:
            self._states.publish(state, stamp)
        self._shown = state
