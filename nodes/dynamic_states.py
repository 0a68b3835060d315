"""Any state interface of any joint, as control_msgs/DynamicJointState."""

from array import array
from collections.abc import Mapping, Sequence
from typing import Protocol

from builtin_interfaces.msg import Time
from control_msgs.msg import DynamicJointState, InterfaceValue
from rclpy.node import Node

from hal.types import JointState
from nodes.qos import LATCHED_WHILE_NEW


class HasInterfaces(Protocol):
    """A controller that shows state interfaces; they and their values come in the same order."""

    @property
    def interfaces(self) -> Mapping[str, tuple[str, ...]]:
        """By joint."""
        ...

    def values(self, state: JointState) -> Sequence[Sequence[float]]:
        """By joint and interface."""
        ...


class DynamicStates:
    """Publishes only to those who listen: filling the message takes longer than the rest of a broadcaster's cycle."""

    def __init__(self, node: Node, topic: str, controller: HasInterfaces, frame_id: str = "") -> None:
        self._controller = controller
        self._topic = node.create_publisher(DynamicJointState, topic, LATCHED_WHILE_NEW)
        interfaces = controller.interfaces
        self._message = DynamicJointState(
            joint_names=list(interfaces),
            interface_values=[InterfaceValue(interface_names=list(names)) for names in interfaces.values()],
        )
        self._message.header.frame_id = frame_id

    def publish(self, state: JointState, stamp: Time) -> None:
        """This state, if anybody listens."""
        if not self._topic.get_subscription_count():
            return
        self._message.header.stamp = stamp
        for joint, values in zip(self._message.interface_values, self._controller.values(state), strict=True):
            joint.values = array("d", values)
        self._topic.publish(self._message)
