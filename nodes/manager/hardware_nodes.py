"""The hardware components' own nodes: their parameters, and ``/diagnostics`` once a second."""

import math
import re
from collections.abc import Callable, Iterator

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from hal.component import Component
from hal.lifecycle import LifecycleState
from hal.types import JointState
from nodes.parameter_node import ParameterNode
from nodes.ros_time import RosTime
from nodes.stack import Stack

COMPENSATION = "gravity_compensation"


class HardwareNodes:
    """The nodes of the ``<ros2_control>`` blocks, each named after its block. ``update`` runs after each cycle."""

    def __init__(self, stack: Stack, ros_time: RosTime) -> None:
        components = stack.description.components
        self.nodes = [ParameterNode(_node_name(component.name), ros_time) for component in components]
        self._stack = stack
        self._state: JointState | None = None
        # The first one speaks for all: they are one process, and its report is one message.
        self._diagnostics = self.nodes[0].create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.nodes[0].create_timer(1.0, self._publish)
        for component, node in zip(components, self.nodes, strict=True):
            if switch := stack.set_compensation.get(component.name):
                node.declare_parameter(COMPENSATION, True)
                node.add_on_set_parameters_callback(_switching(switch))

    def update(self, state: JointState) -> None:
        """Keep the newest state for the next report."""
        self._state = state

    def _publish(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self.nodes[0].get_clock().now().to_msg()
        message.status = [self._loop_status()]
        for component in self._stack.loop.hardware.components:
            message.status.append(_component_status(component))
            message.status += self._servo_statuses(component)
        message.status += self._line_statuses()
        self._diagnostics.publish(message)

    def _loop_status(self) -> DiagnosticStatus:
        loop = self._stack.loop
        figures = loop.figures
        return DiagnosticStatus(
            level=DiagnosticStatus.WARN if figures.missed or figures.unmeasured else DiagnosticStatus.OK,
            name="servoloop: control loop",
            message=figures.summary,
            hardware_id=self._stack.component.name,
            values=_values(
                rate_hz=f"{1.0 / loop.period_s:g}",
                cycles=figures.cycles,
                missed_cycles=figures.missed,
                unmeasured_cycles=figures.unmeasured,
                latest_wake_up_ms=f"{figures.latest_wake_up_s * 1e3:.3f}",
                longest_cycle_ms=f"{figures.longest_cycle_s * 1e3:.3f}",
                mean_cycle_ms=f"{figures.busy_s / max(1, figures.cycles) * 1e3:.3f}",
            ),
        )

    def _servo_statuses(self, component: Component) -> Iterator[DiagnosticStatus]:
        for joint in component.hardware.joints:
            if self._state is not None and joint in self._stack.servo_ids:
                yield self._servo_status(self._state, joint, component.name)

    def _servo_status(self, state: JointState, joint: str, component: str) -> DiagnosticStatus:
        servo_id = self._stack.servo_ids[joint]
        status = DiagnosticStatus(
            name=f"servoloop: {joint} (servo {servo_id})",
            hardware_id=f"{component}/{servo_id}",
            level=DiagnosticStatus.OK,
            message="ok",
        )
        health = state.health.get(joint)
        if health is not None:
            status.values = _values(voltage_v=f"{health.voltage_v:.1f}", temperature_c=f"{health.temperature_c:.0f}")
            if not math.isnan(health.current_a):
                status.values += _values(current_a=f"{health.current_a:.2f}")
            if health.counters is not None:
                status.values += _values(**health.counters.as_dict())
            if health.alarms:
                status.level = DiagnosticStatus.WARN
                status.message = f"alarm: {', '.join(health.alarms)}"
        if joint in state.faults:
            status.level, status.message = DiagnosticStatus.ERROR, state.faults[joint].text
        return status

    def _line_statuses(self) -> Iterator[DiagnosticStatus]:
        """The counters of each serial line that belong to no servo; a lost line is in its component's status."""
        for port, counters in self._state.lines.items() if self._state is not None else ():
            yield DiagnosticStatus(
                level=DiagnosticStatus.OK,
                name=f"servoloop: {port}",
                message="counted since it was opened",
                hardware_id=port,
                values=_values(noise=counters.noise, strange=counters.strange),
            )


def _node_name(component: str) -> str:
    """A component may be called anything, a node has letters, digits and underscores."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", component)
    return f"_{name}" if name[0].isdigit() else name


def _component_status(component: Component) -> DiagnosticStatus:
    error = component.error  # the loop's thread may take it away meanwhile
    active = component.state is LifecycleState.ACTIVE and error is None
    status = DiagnosticStatus(
        level=DiagnosticStatus.OK if active else DiagnosticStatus.WARN,
        name=f"servoloop: {component.name}",
        message=component.state.name.lower(),
        hardware_id=component.name,
    )
    if error is not None:
        status.level, status.message = DiagnosticStatus.ERROR, f"lost: {error}. Mend it, then activate it again"
    return status


def _switching(switch: Callable[[bool], None]) -> Callable[[list[Parameter]], SetParametersResult]:
    def on_parameters(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == COMPENSATION:
                switch(bool(parameter.value))
        return SetParametersResult(successful=True)

    return on_parameters


def _values(**values: object) -> list[KeyValue]:
    return [KeyValue(key=key, value=str(value)) for key, value in values.items()]
