"""A user's controller and hardware as Python classes. User classes appear in the graph like the built-in classes."""

from pathlib import Path

import pytest
from controller_manager_msgs.srv import ListHardwareComponents, SetHardwareComponentState
from lifecycle_msgs.msg import State
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray

from tests.controller.test_manager_plugin import block, install
from tests.pages import code
from tests.ros.manager_client import MANAGER, ManagerClient, manager_client
from tests.ros.stack_process import running
from tests.servoloop.test_own_hardware import PAGE
from tests.servoloop.test_own_hardware import URDF as BELT

INTERFACE_NODE = """
from rcl_interfaces.msg import ParameterDescriptor
from std_msgs.msg import Float64
from std_srvs.srv import Trigger


class WaveNode:
    def __init__(self, node, controller):
        self.controller = controller
        self.publisher = node.create_publisher(Float64, "~/swing", 10)
        node.declare_parameter("unit", "rad", ParameterDescriptor(read_only=True))
        node.create_service(Trigger, "~/stop", lambda request, response: response)
        node.create_timer(1.0, lambda: None)

    def publish(self, stamp):
        if self.controller.parameters.amplitude > 0.5:
            raise RuntimeError("too wide")
        self.publisher.publish(Float64(data=float(self.controller.command[0])))
"""


BELT_CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    driver: {type: velocity_controllers/JointGroupVelocityController}
driver: {ros__parameters: {joints: [belt], command_timeout: 0.0}}
"""
VELOCITY = '<state_interface name="velocity"/>'


@pytest.mark.row("trouble-python")
def test_user_controller_has_its_interface_node(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(
        tmp_path,
        "joint_wave",
        block("python"),
        "joint_wave/Wave = joint_wave:Wave\n[servoloop.controller_nodes]\njoint_wave/Wave = wave_node:WaveNode",
    )
    (tmp_path / "wave_node.py").write_text(INTERFACE_NODE)
    (tmp_path / "controllers.yaml").write_text(block("yaml"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    options = ("--hardware", "mock", "--controllers", str(tmp_path / "controllers.yaml"))
    with running(tmp_path, *options) as stack, manager_client() as client:
        swings: list[float] = []
        client.node.create_subscription(Float64, "/wave/swing", lambda message: swings.append(message.data), 10)
        assert client.states() == {"wave": "active"}
        client.spin_until(lambda: max(swings, default=0.0) > 0.05)
        assert "read-only" in client.put("/wave", "joint", "joint1")
        assert "must be at least 0" in client.put("/wave", "amplitude", -1.0)
        assert client.put("/wave", "amplitude", 0.6) == ""  # From here on, only the interface of the controller fails.
        client.spin_until(lambda: "controller wave stops publishing because of this error" in stack.words)
        assert client.states() == {"wave": "active"}
        assert client.switch((), ["wave"])[0] and client.cleanup("wave")
        client.spin_until(lambda: "/wave/stop" not in dict(client.node.get_service_names_and_types()))
        assert not {"unit"} & client.parameters("/wave")
        assert client.put("/wave", "amplitude", 0.2) == ""
        assert client.configure("wave") and client.configure("wave")
        assert client.get("/wave", "unit", "amplitude") == ["rad", 0.2]
        swings.clear()
        assert client.switch(["wave"])[0]
        client.spin_until(lambda: max(swings, default=0.0) > 0.05)  # a new interface on the same node
        assert "its ROS node is incomplete" not in stack.words
        assert client.switch((), ["wave"])[0] and client.unload("wave")
        client.spin_until(lambda: "wave" not in client.node.get_node_names())
        assert client.get(MANAGER, "wave.type") == ["joint_wave/Wave"]


@pytest.mark.row("trouble-python")
def test_user_hardware_is_driven_and_switched(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the conveyor of docs/hardware.md: commanded by topic, read in ``/joint_states`` and stopped by a service."""
    install(tmp_path, "belt", code(PAGE, "python"), "[servoloop.hardware]\nfactory/Belt = belt:Belt")
    (tmp_path / "belt.urdf").write_text(BELT.replace(VELOCITY, f'<state_interface name="position"/>{VELOCITY}'))
    (tmp_path / "controllers.yaml").write_text(BELT_CONTROLLERS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    options = ("--urdf", str(tmp_path / "belt.urdf"), "--controllers", str(tmp_path / "controllers.yaml"))
    with running(tmp_path, *options), manager_client() as client:
        (component,) = client.call(ListHardwareComponents, f"{MANAGER}/list_hardware_components").component
        assert (component.name, component.type, component.plugin_name) == ("conveyor", "actuator", "factory/Belt")
        assert client.states() == {"joint_state_broadcaster": "active", "driver": "active"}
        publisher = client.node.create_publisher(Float64MultiArray, "/driver/commands", 1)
        with client.hearing(JointState, "/joint_states") as heard:

            def runs() -> bool:
                # Send repeatedly, because a best-effort subscriber may not have discovered the new publisher yet.
                publisher.publish(Float64MultiArray(data=[0.3]))
                return bool(heard) and heard[-1].velocity[0] == pytest.approx(0.3)

            client.spin_until(runs)
            at_speed = heard[-1].position[0]
            client.spin_until(lambda: heard[-1].position[0] > at_speed + 0.1)
            _set(client, "inactive")
            client.spin_until(lambda: heard[-1].velocity[0] == 0.0)
        assert client.states() == {"joint_state_broadcaster": "active", "driver": "inactive"}
        _set(client, "active")
        assert client.switch(["driver"])[0]


def _set(client: ManagerClient, label: str) -> None:
    service = f"{MANAGER}/set_hardware_component_state"
    answer = client.call(SetHardwareComponentState, service, name="conveyor", target_state=State(label=label))
    assert (answer.ok, answer.state.label) == (True, label)
