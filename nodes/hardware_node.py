"""The hardware component's own node: its parameters, and ``/diagnostics`` once a second."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from hal.types import JointState
from nodes.stack import Stack

INTERPOLATION = "servo_interpolation"


class HardwareNode:
    """Named after the ``<ros2_control>`` block. ``see`` runs after each cycle."""

    def __init__(self, stack: Stack) -> None:
        self.node = Node(stack.component.name)
        self._stack = stack
        self._state: JointState | None = None
        self._diagnostics = self.node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.node.create_timer(1.0, self._publish)
        if stack.set_interpolation is not None:
            self.node.declare_parameter(INTERPOLATION, True)
            self.node.add_on_set_parameters_callback(self._on_parameters)

    def see(self, state: JointState) -> None:
        """Keep the newest state for the next report."""
        self._state = state

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == INTERPOLATION and self._stack.set_interpolation is not None:
                self._stack.set_interpolation(bool(parameter.value))
        return SetParametersResult(successful=True)

    def _publish(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self.node.get_clock().now().to_msg()
        message.status = [self._loop_status()]
        if self._state is not None:
            message.status += [self._servo_status(self._state, joint) for joint in self._stack.servo_ids]
        self._diagnostics.publish(message)

    def _loop_status(self) -> DiagnosticStatus:
        loop = self._stack.loop
        figures = loop.figures
        return DiagnosticStatus(
            level=DiagnosticStatus.WARN if figures.missed else DiagnosticStatus.OK,
            name="servoloop: control loop",
            message=f"{figures.missed} cycles missed" if figures.missed else "every cycle on time",
            hardware_id=self._stack.component.name,
            values=_values(
                rate_hz=f"{1.0 / loop.period_s:g}",
                cycles=figures.cycles,
                missed_cycles=figures.missed,
                latest_wake_up_ms=f"{figures.latest_wake_up_s * 1e3:.3f}",
                longest_cycle_ms=f"{figures.longest_cycle_s * 1e3:.3f}",
                mean_cycle_ms=f"{figures.busy_s / max(1, figures.cycles) * 1e3:.3f}",
            ),
        )

    def _servo_status(self, state: JointState, joint: str) -> DiagnosticStatus:
        servo_id = self._stack.servo_ids[joint]
        status = DiagnosticStatus(
            name=f"servoloop: {joint} (servo {servo_id})",
            hardware_id=f"{self._stack.component.name}/{servo_id}",
            level=DiagnosticStatus.OK,
            message="ok",
        )
        health = state.health.get(joint)
        if health is not None:
            status.values = _values(voltage_v=f"{health.voltage_v:.1f}", temperature_c=f"{health.temperature_c:.0f}")
            if health.counters is not None:
                status.values += _values(**health.counters.as_dict())
            if health.alarms:
                status.level = DiagnosticStatus.WARN
                status.message = f"alarm: {', '.join(health.alarms)}"
        if joint in state.faults:
            status.level, status.message = DiagnosticStatus.ERROR, state.faults[joint]
        return status


def _values(**values: object) -> list[KeyValue]:
    return [KeyValue(key=key, value=str(value)) for key, value in values.items()]
