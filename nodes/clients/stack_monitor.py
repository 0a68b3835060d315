"""Monitor a running stack through its topics, for the browser view and the report."""

from dataclasses import dataclass, field

import numpy as np
from control_msgs.msg import JointTrajectoryControllerState
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from hal.types import FloatArray
from nodes.namespace import namespace_of
from nodes.ros_process import spin_until_done

LOOP_STATUS = "servoloop: control loop"


@dataclass(frozen=True, slots=True)
class Sample:
    """State of the arm controller in one cycle. The arrays have shape (n,), in rad and rad/s; the stamp is ROS time."""

    stamp_s: float
    reference: FloatArray
    reference_velocity: FloatArray
    feedback: FloatArray


@dataclass(slots=True)
class NewestMessages:
    """The latest message of each topic."""

    position: dict[str, float] = field(default_factory=dict)
    velocity: dict[str, float] = field(default_factory=dict)
    error: dict[str, float] = field(default_factory=dict)
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)
    """Values of each diagnostic status, keyed by status name; the key ``message`` contains the message of the
    status."""
    samples: list[Sample] = field(default_factory=list)
    """Samples of all cycles since the caller last cleared the list."""

    @property
    def loop(self) -> dict[str, str]:
        """Statistics of the control loop from /diagnostics."""
        return self.diagnostics.get(LOOP_STATUS, {})

    def servo(self, joint: str) -> dict[str, str]:
        """Return the diagnostic values of a joint's servo."""
        for name, values in self.diagnostics.items():
            if name.startswith(f"servoloop: {joint} "):
                return values
        return {}


class StackMonitor:
    """Subscriber to the topics of a stack. The subscriber receives messages only while the caller spins."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, arm: str) -> None:
        self.newest = NewestMessages()
        self._node = node
        self._executor = executor
        namespace = namespace_of(node)
        self._prefix = f"{namespace}/" if namespace else ""
        """Prefix of this stack's status names, because all namespaces share /diagnostics."""
        node.create_subscription(JointState, "joint_states", self._on_joints, 10)
        node.create_subscription(JointTrajectoryControllerState, f"{arm}/controller_state", self._on_state, 50)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def spin(self, seconds: float) -> None:
        """Receive messages, waiting at most ``seconds`` for a message."""
        self._executor.spin_once(timeout_sec=seconds)

    def set_parameter(self, node_name: str, name: str, value: bool | float) -> bool:
        """Set a parameter of another node and return whether the node accepted it."""
        client = self._node.create_client(SetParameters, f"{node_name}/set_parameters")
        if not client.wait_for_service(timeout_sec=5.0):
            return False
        parameter = Parameter(name, value=value).to_parameter_msg()
        future = client.call_async(SetParameters.Request(parameters=[parameter]))
        spin_until_done(self._executor, future, 5.0)
        response = future.result()
        return response is not None and all(result.successful for result in response.results)

    def _on_joints(self, message: JointState) -> None:
        self.newest.position = dict(zip(message.name, message.position, strict=True))
        self.newest.velocity = dict(zip(message.name, message.velocity, strict=True))

    def _on_state(self, message: JointTrajectoryControllerState) -> None:
        error = message.error.positions
        self.newest.error = dict(zip(message.joint_names, error, strict=True))
        self.newest.samples.append(
            Sample(
                message.header.stamp.sec + message.header.stamp.nanosec * 1e-9,
                np.array(message.reference.positions),
                np.array(message.reference.velocities),
                np.array(message.feedback.positions),
            )
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if not status.name.startswith(self._prefix):
                continue
            values = {item.key: item.value for item in status.values}
            self.newest.diagnostics[status.name.removeprefix(self._prefix)] = {**values, "message": status.message}
