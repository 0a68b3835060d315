"""Node that publishes the arm's states, receives its commands, and reports on both in ``/diagnostics``."""

from collections.abc import Iterator
from time import monotonic
from typing import Final

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState as JointStateMessage

from controller.broadcasters.joint_state_broadcaster import BroadcasterParameters, JointStateBroadcaster
from controller.diagnostics import Level, Status, statuses
from controller.host.host_controller import HostController, HostPhase
from controller.host.joint_commands import RefusedCommandError
from drivers.printable import printable
from hal.types import JointState
from nodes.manager.hardware_nodes import diagnostic_message
from nodes.only_one import OtherNodes
from nodes.parameter_node import ParameterNode
from nodes.publishing import numbers
from nodes.ros_time import RosTime
from nodes.stack import Stack
from nodes.topic_host.topics import NAME, OTHER, HostTopics

STATUS: Final = "servoloop: topic host"
"""Name of the diagnostic status that reports on the topics."""
REPEAT_S: Final = 5.0
"""Minimum time between two reports of the same reason for rejecting a message, in seconds."""
RELIABLE: Final = QoSProfile(depth=1)
"""QoS profile for the plugin's commands. A best-effort subscriber, such as the plugin, also receives reliable
states."""
DIAGNOSTICS_S: Final = 1.0


class HostNode:
    """Node of the arm. ``publish`` must be called after each cycle. All other methods are callbacks."""

    def __init__(self, stack: Stack, controller: HostController, topics: HostTopics, ros_time: RosTime) -> None:
        self.node = node = ParameterNode(NAME, ros_time)
        self._stack, self._controller = stack, controller
        self._commands = node.resolve_topic_name(topics.commands)
        """Name of the command topic."""
        context = stack.factory.context
        self._broadcaster = JointStateBroadcaster.build(NAME, BroadcasterParameters(), context)
        self._message = JointStateMessage(name=list(self._broadcaster.names))
        self._states = node.create_publisher(JointStateMessage, topics.states, RELIABLE)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        events = SubscriptionEventCallbacks(matched=self._on_matched)
        node.create_subscription(JointStateMessage, topics.commands, self._on_command, RELIABLE, event_callbacks=events)
        node.create_timer(DIAGNOSTICS_S, self._report)
        self.others = OtherNodes(node, OTHER)
        self._senders = 0
        """Number of programs that publish commands."""
        self._state: JointState | None = None
        self._unpublished = ""
        """Reason why the latest state was not published, or empty if it was published."""
        self._refusals = 0
        self._refused, self._refused_s = "", -REPEAT_S
        """Reason and time (in seconds) of the last report about a rejected message."""

    def publish(self, state: JointState, stamp: Time) -> None:
        """Publish the states of all joints, or nothing if a joint was not measured in this cycle.

        The plugin does not check the age of a state, so it keeps using the last message.
        """
        self._state = state
        states = self._broadcaster.sample(state)
        fault = next(iter(state.faults.values()), None)
        self._unpublished = fault.text if fault is not None else ""
        if fault is not None:
            return
        message = self._message
        message.header.stamp = stamp
        message.position = numbers(states.position)
        # One version of the plugin fails if a message contains values for interfaces that the plugin's ros2_control
        # block does not declare.
        message.velocity, message.effort = (
            numbers(values if np.isfinite(values).all() else values[:0]) for values in (states.velocity, states.effort)
        )
        self._states.publish(message)

    def _on_command(self, message: JointStateMessage) -> None:
        try:
            self._controller.submit(message.name, message.position)
        except RefusedCommandError as error:
            self._refuse(str(error))

    def _refuse(self, reason: str) -> None:
        self._refusals += 1
        now_s = monotonic()
        if reason != self._refused or now_s >= self._refused_s + REPEAT_S:
            self._refused, self._refused_s = reason, now_s
            self.node.get_logger().error(printable(f"{self._commands}: {reason}. The message is dropped"))

    def _on_matched(self, info: QoSSubscriptionMatchedInfo) -> None:
        before, self._senders = self._senders, info.current_count
        if before and not self._senders:
            self._controller.lose(f"no program publishes to {self._commands} any longer")
        elif self._senders > max(before, 1):
            self.node.get_logger().warning(
                f"{self._senders} programs publish to {self._commands}, and the arm follows all of them: keep only one"
            )

    def _report(self) -> None:
        stack = self._stack
        message = DiagnosticArray()
        message.header.stamp = self.node.get_clock().now().to_msg()
        known = statuses(stack.loop, stack.component.name, stack.servo_ids, self._state)
        message.status = [diagnostic_message(status, stack.namespace) for status in (*known, *self._statuses())]
        self._diagnostics.publish(message)

    def _statuses(self) -> Iterator[Status]:
        phase, reason = self._controller.phase, self._controller.reason
        held = phase is HostPhase.HOLDING
        text = f"{phase}: {reason}" if held else str(phase)
        level = Level.WARN if held or self._senders > 1 else Level.OK
        if self._unpublished:
            level, text = Level.ERROR, f"no states are published: {self._unpublished}"
        values = {"senders": str(self._senders), "refused_messages": str(self._refusals)}
        yield Status(level, STATUS, text, self._stack.component.name, values)
        yield self.others.status(self._stack.component.name)
