"""The joint state broadcaster's face: ``/joint_states``."""

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from controller.joint_state_broadcaster import JointStateBroadcaster

# Upstream's publisher is transient local: a late subscriber gets the newest state at once.
_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class JointStateNode:
    """One node named after its controller. ``publish`` runs after each cycle."""

    def __init__(self, controller: JointStateBroadcaster) -> None:
        self.node = Node(controller.name)
        self._controller = controller
        self._publisher = self.node.create_publisher(JointState, "/joint_states", _QOS)

    def publish(self, stamp: Time) -> None:
        """The newest state, once."""
        states = self._controller.latest
        if states is None:
            return
        message = JointState()
        message.header.stamp = stamp
        message.header.frame_id = "base_link"
        message.name = list(states.names)
        message.position = states.position.tolist()
        message.velocity = states.velocity.tolist()
        message.effort = states.effort.tolist()
        self._publisher.publish(message)
