"""Create the nodes of the hardware components, with their parameters and ``/diagnostics`` at 1 Hz."""

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from controller.diagnostics import Status, statuses
from hal.robot_description.node_names import component_node
from hal.types import JointState
from nodes.only_one import OtherNodes
from nodes.parameter_node import ParameterNode
from nodes.ros_time import RosTime
from nodes.stack import Stack

COMPENSATION = "gravity_compensation"


class HardwareNodes:
    """Nodes of the ``<ros2_control>`` blocks, each named after its block. ``update`` must be called after each
    cycle."""

    def __init__(self, stack: Stack, ros_time: RosTime, others: OtherNodes) -> None:
        components = stack.description.components
        self.nodes = [ParameterNode(component_node(component.name), ros_time) for component in components]
        self._stack, self._others = stack, others
        self._state: JointState | None = None
        # The first node reports for all components in one message, because all components run in the same process.
        self._diagnostics = self.nodes[0].create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.nodes[0].create_timer(1.0, self._publish)
        for component, node in zip(components, self.nodes, strict=True):
            if switch := stack.set_compensation.get(component.name):
                node.declare_parameter(COMPENSATION, True)
                node.add_on_set_parameters_callback(_switching(switch))

    def update(self, state: JointState) -> None:
        """Store the latest state for the next report."""
        self._state = state

    def _publish(self) -> None:
        stack = self._stack
        message = DiagnosticArray()
        message.header.stamp = self.nodes[0].get_clock().now().to_msg()
        known = statuses(stack.loop, stack.component.name, stack.servo_ids, self._state)
        other = self._others.status(stack.component.name)
        message.status = [diagnostic_message(status, stack.namespace) for status in (*known, other)]
        self._diagnostics.publish(message)


def diagnostic_message(status: Status, namespace: str) -> DiagnosticStatus:
    """Convert a status to its message.

    The name in the message begins with the stack's namespace, because all namespaces share /diagnostics.
    """
    return DiagnosticStatus(
        level=bytes([status.level]),
        name=f"{namespace}/{status.name}" if namespace else status.name,
        message=status.message,
        hardware_id=status.hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in status.values.items()],
    )


def _switching(switch: Callable[[bool], None]) -> Callable[[list[Parameter]], SetParametersResult]:
    def on_parameters(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == COMPENSATION:
                switch(bool(parameter.value))
        return SetParametersResult(successful=True)

    return on_parameters
