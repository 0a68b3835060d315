"""Publish the broadcaster topics ``joint_states`` and ``dynamic_joint_states``."""

from array import array
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from builtin_interfaces.msg import Time
from control_msgs.msg import DynamicJointState, InterfaceValue
from rclpy.node import Node
from sensor_msgs.msg import JointState as JointStateMessage

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster, JointStates
from controller.broadcasters.servo_state_broadcaster import ServoStateBroadcaster
from hal.types import JointState
from nodes.publishing import LATCHED, LATCHED_WHILE_NEW, numbers


class HasInterfaces(Protocol):
    """Controller that has state interfaces. The interfaces and their values are in the same order."""

    @property
    def interfaces(self) -> Mapping[str, tuple[str, ...]]:
        """Interface names, keyed by joint."""
        ...

    def values(self, state: JointState) -> Sequence[Sequence[float]]:
        """Return the values of each joint, in the order of its interfaces."""
        ...


class DynamicStates:
    """Publisher of ``dynamic_joint_states``. The publisher fills in its message only if there is a subscriber, because
    filling it in is slow."""

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
        """Publish the state if there is a subscriber."""
        if not self._topic.get_subscription_count():
            return
        self._message.header.stamp = stamp
        for joint, values in zip(self._message.interface_values, self._controller.values(state), strict=True):
            joint.values = array("d", values)
        self._topic.publish(self._message)


class JointStateNode:
    """Interface node of a joint state broadcaster. The node publishes a message for every cycle."""

    def __init__(self, node: Node, controller: JointStateBroadcaster) -> None:
        self.node = node
        self._controller = controller
        parameters = controller.parameters
        folder = "~/" if parameters.use_local_topics else ""
        self._topic = node.create_publisher(JointStateMessage, f"{folder}joint_states", LATCHED)
        self._message = JointStateMessage(name=list(controller.names))
        self._message.header.frame_id = parameters.frame_id
        source = parameters.source("position")
        self._has_position = np.array([source in controller.interfaces[name] for name in controller.names], dtype=bool)
        self._known = np.ones(len(controller.names), dtype=bool)
        self._dynamic: DynamicStates | None = None
        if parameters.publish_dynamic_joint_states:
            topic = f"{folder}dynamic_joint_states"
            self._dynamic = DynamicStates(node, topic, controller, parameters.frame_id)

    def publish_cycle(self, state: JointState, stamp: Time) -> None:
        """Publish the state of one cycle. The message is reused, because publishing serializes it immediately."""
        if self._controller.state is None:
            return
        self._fill(self._controller.sample(state))
        if self._message.name:
            self._message.header.stamp = stamp
            self._topic.publish(self._message)
        if self._dynamic is not None:
            self._dynamic.publish(state, stamp)

    def _fill(self, states: JointStates) -> None:
        """Fill in the message. Joints that have never been measured are omitted, because their positions would be
        NaN."""
        known = ~(np.isnan(states.position) & self._has_position)
        message = self._message
        if (known != self._known).any():
            message.name = [name for name, is_known in zip(states.names, known, strict=True) if is_known]
            self._known = known
        message.position = numbers(states.position[known])
        message.velocity = numbers(states.velocity[known])
        message.effort = numbers(states.effort[known])


class ServoStateNode:
    """Interface node of a servo state broadcaster. ``publish`` is called after each cycle, but publishes a state only
    if it is new."""

    def __init__(self, node: Node, controller: ServoStateBroadcaster) -> None:
        self.node = node
        self._controller = controller
        self._states = DynamicStates(node, "~/dynamic_joint_states", controller)
        self._published: JointState | None = None

    def publish(self, stamp: Time) -> None:
        """Publish the state if it is new."""
        state = self._controller.state
        if state is not None and state is not self._published:
            self._states.publish(state, stamp)
        self._published = state
