"""``/robot_description``, ``/tf`` and ``/tf_static``: the arm's links, and the scene's objects."""

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from controller.joint_state_broadcaster import JointStates
from hal.kinematics import child_pose
from nodes.conversions import transform_message
from nodes.stack import Stack

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_BASE = "base_link"


class RobotStatePublisher:
    """Fixed joints once, the others after each cycle; mimic joints follow theirs."""

    def __init__(self, stack: Stack) -> None:
        self.node = Node("robot_state_publisher")
        self._stack = stack
        joints = stack.description.joints.values()
        self._fixed = [joint for joint in joints if joint.kind == "fixed"]
        self._moving = [joint for joint in joints if joint.kind != "fixed"]
        self._tf = self.node.create_publisher(TFMessage, "/tf", 100)
        self._tf_static = self.node.create_publisher(TFMessage, "/tf_static", _LATCHED)
        self._description = self.node.create_publisher(String, "/robot_description", _LATCHED)
        self._description.publish(String(data=stack.description.xml))
        self._publish_fixed(self.node.get_clock().now().to_msg())

    def publish(self, states: JointStates, stamp: Time) -> None:
        """The moving links at the measured positions, and what the simulation sees."""
        position = dict(zip(states.names, states.position, strict=True))
        transforms = [
            transform_message(j.parent, j.child, *child_pose(j, float(position[j.name])), stamp)
            for j in self._moving
            if j.name in position and position[j.name] == position[j.name]  # not NaN
        ]
        for name, pose in self._stack.scene().items():
            transforms.append(transform_message(_BASE, name, *pose, stamp))
        self._tf.publish(TFMessage(transforms=transforms))

    def _publish_fixed(self, stamp: Time) -> None:
        transforms = [transform_message(j.parent, j.child, *child_pose(j, 0.0), stamp) for j in self._fixed]
        self._tf_static.publish(TFMessage(transforms=transforms))
