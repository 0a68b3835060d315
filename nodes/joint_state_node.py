"""The joint state broadcaster's face: ``joint_states`` and ``dynamic_joint_states``."""

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState

from controller.joint_state_broadcaster import JointStateBroadcaster, JointStates
from hal.types import FloatArray
from hal.types import JointState as HardwareState
from nodes.dynamic_states import DynamicStates
from nodes.qos import LATCHED


class JointStateNode:
    """On the node of its controller, a message for each cycle."""

    def __init__(self, node: Node, controller: JointStateBroadcaster) -> None:
        self.node = node
        self._controller = controller
        parameters = controller.parameters
        folder = "~/" if parameters.use_local_topics else ""
        self._topic = node.create_publisher(JointState, f"{folder}joint_states", LATCHED)
        self._message = JointState(name=list(controller.names))
        self._message.header.frame_id = parameters.frame_id
        source = parameters.source("position")
        self._has_position = np.array([source in controller.interfaces[name] for name in controller.names], dtype=bool)
        self._known = np.ones(len(controller.names), dtype=bool)
        self._dynamic: DynamicStates | None = None
        if parameters.publish_dynamic_joint_states:
            topic = f"{folder}dynamic_joint_states"
            self._dynamic = DynamicStates(node, topic, controller, parameters.frame_id)

    def show(self, state: HardwareState, stamp: Time) -> None:
        """The state of one cycle. One message serves all: publishing writes it out at once."""
        if self._controller.state is None:
            return
        self._fill(self._controller.sample(state))
        if self._message.name:
            self._message.header.stamp = stamp
            self._topic.publish(self._message)
        if self._dynamic is not None:
            self._dynamic.publish(state, stamp)

    def _fill(self, states: JointStates) -> None:
        """A joint that has never been measured is left out: a position of NaN is of no use to anybody."""
        known = ~(np.isnan(states.position) & self._has_position)
        message = self._message
        if (known != self._known).any():
            message.name = [name for name, is_known in zip(states.names, known, strict=True) if is_known]
            self._known = known
        message.position = _numbers(states.position[known])
        message.velocity = _numbers(states.velocity[known])
        message.effort = _numbers(states.effort[known])


def _numbers(values: FloatArray) -> "array[float]":
    """A message takes an array as it is, and looks at every number of a list."""
    return array("d", values.tobytes())
