"""Names, types and contents of the whole stack, as seen from another process and defined in pick-place.md."""

from collections.abc import Iterator
from typing import Any

import pytest
from controller_manager_msgs.srv import ListControllers, ListHardwareComponents, ListHardwareInterfaces
from rclpy.action import get_action_names_and_types
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from tests.ros.stack_process import ArmClient, StackProcess, arm_client, running, until

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

TOPICS = {
    "/hand_controller/commands": "std_msgs/msg/Float64MultiArray",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/robot_description": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/arm_controller/controller_state": "control_msgs/msg/JointTrajectoryControllerState",
    "/sorting/arm/state": "std_msgs/msg/String",
    "/sorting/perception/apple_quality": "apple_quality_msgs/msg/AppleQualityArray",
}
SERVICES = {
    "/controller_manager/list_controllers": "controller_manager_msgs/srv/ListControllers",
    "/controller_manager/list_hardware_components": "controller_manager_msgs/srv/ListHardwareComponents",
    "/controller_manager/list_hardware_interfaces": "controller_manager_msgs/srv/ListHardwareInterfaces",
    "/sorting/arm/enable": "std_srvs/srv/SetBool",
}
ACTIONS = {
    "/arm_controller/follow_joint_trajectory": "control_msgs/action/FollowJointTrajectory",
    "/sorting/arm/pick_place": "sorting_arm_interfaces/action/PickPlace",
}
NODES = {
    "controller_manager",
    "arm_controller",
    "hand_controller",
    "joint_state_broadcaster",
    "robot_arm",
    "robot_state_publisher",
    "vision_pick_place_controller",
}


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("stack")
    with running(folder) as stack:
        node = StackProcess(folder / "node.log", module="nodes.vision_pick_place_controller")
        yield stack
        node.end()


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[ArmClient]:
    with arm_client() as client:
        yield client


def test_names_and_types_are_those_of_the_course(client: ArmClient) -> None:
    def missing() -> list[tuple[str, str]]:
        node = client.node
        seen = {
            **dict(node.get_topic_names_and_types()),
            **dict(node.get_service_names_and_types()),
            **dict(get_action_names_and_types(node)),
        }
        wanted = {**TOPICS, **SERVICES, **ACTIONS}
        return [(name, kind) for name, kind in wanted.items() if seen.get(name) != [kind]]

    client.spin_until(lambda: not missing())
    client.spin_until(lambda: set(client.node.get_node_names()) >= NODES)


def _first(client: ArmClient, kind: Any, topic: str, qos: Any = 10) -> Any:
    """Return the first message on a topic."""
    messages: list[Any] = []
    subscription = client.node.create_subscription(kind, topic, messages.append, qos)
    client.spin_until(lambda: bool(messages))
    client.node.destroy_subscription(subscription)
    return messages[0]


def test_joint_states_name_all_joints_in_alphabetical_order(client: ArmClient) -> None:
    message = _first(client, JointState, "/joint_states")
    assert message.name == ["hand_left_joint", "hand_right_joint", *(f"joint{i}" for i in range(1, 7))]
    assert len(message.position) == len(message.velocity) == len(message.effort) == 8
    assert message.header.frame_id == "base_link"


def test_late_subscriber_receives_the_robot_description(client: ArmClient) -> None:
    assert "<ros2_control" in _first(client, String, "/robot_description", LATCHED).data


def test_tf_shows_the_arm_the_cube_and_the_bins(client: ArmClient) -> None:
    def frames(message: TFMessage) -> set[tuple[str, str]]:
        return {(t.header.frame_id, t.child_frame_id) for t in message.transforms}

    message = _first(client, TFMessage, "/tf")
    scene = {("base_link", name) for name in ("cube", "bin_A", "bin_B", "bin_C")}
    assert frames(message) >= {*scene, ("base_link", "link1")}


def test_list_services_respond_as_ros2_control_expects(client: ArmClient) -> None:
    def ask(kind: Any, name: str) -> Any:
        service = client.node.create_client(kind, f"/controller_manager/{name}")
        assert service.wait_for_service(30.0)
        return client.wait(service.call_async(kind.Request()))

    controllers = {c.name: c for c in ask(ListControllers, "list_controllers").controller}
    assert {name: c.state for name, c in controllers.items()} == {
        "joint_state_broadcaster": "active",
        "arm_controller": "active",
        "hand_controller": "active",
    }
    assert controllers["hand_controller"].claimed_interfaces == ["hand_right_joint/position"]
    assert controllers["arm_controller"].type == "joint_trajectory_controller/JointTrajectoryController"
    (component,) = ask(ListHardwareComponents, "list_hardware_components").component
    assert (component.name, component.state.label, component.rw_rate) == ("robot_arm", "active", 20)
    interfaces = ask(ListHardwareInterfaces, "list_hardware_interfaces")
    assert all(i.is_claimed for i in interfaces.command_interfaces)
    assert len(interfaces.command_interfaces) == 7


def test_stack_reports_when_it_is_ready(stack: StackProcess) -> None:
    until(lambda: "ready: robot_arm at 20 Hz" in stack.words)
