"""The graph of a running stack, as seen from another process: nodes, services, topics and QoS."""

from collections.abc import Callable, Iterator
from functools import partial

import pytest
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Float64MultiArray

from tests.ros.manager_bench import manager_stack
from tests.ros.manager_client import MANAGER, ManagerClient, manager_client
from tests.ros.stack_process import StackProcess

ARM = "/arm_controller"
NODES = ("controller_manager", "arm_controller", "hand_controller", "joint_state_broadcaster", "robot_arm")
PARAMETER_SERVICES = {
    "describe_parameters": "DescribeParameters",
    "get_parameter_types": "GetParameterTypes",
    "get_parameters": "GetParameters",
    "list_parameters": "ListParameters",
    "set_parameters": "SetParameters",
    "set_parameters_atomically": "SetParametersAtomically",
}
MANAGER_SERVICES = {
    "list_controllers": "ListControllers",
    "list_controller_types": "ListControllerTypes",
    "list_hardware_components": "ListHardwareComponents",
    "list_hardware_interfaces": "ListHardwareInterfaces",
    "load_controller": "LoadController",
    "configure_controller": "ConfigureController",
    "cleanup_controller": "CleanupController",
    "unload_controller": "UnloadController",
    "switch_controller": "SwitchController",
    "set_hardware_component_state": "SetHardwareComponentState",
    "reload_controller_libraries": "ReloadControllerLibraries",
}
LATCHED = (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
RELIABLE = (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
EVERY_PUBLISHER = (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    with manager_stack(tmp_path_factory.mktemp("graph")) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[ManagerClient]:
    """Provide a client that has discovered all nodes."""
    with manager_client() as client:
        client.spin_until(lambda: set(NODES) <= set(client.node.get_node_names()))
        yield client


Look = Callable[[str, str], list[tuple[str, list[str]]]]
"""Query function for the entities of a node, by node name and namespace."""


def of_node(look: Look, node: str) -> dict[str, str]:
    """Return the names and types of the entities that ``look`` finds for a node in the root namespace."""
    return {name: " ".join(kinds) for name, kinds in look(node.strip("/"), "/")}


def expect(client: ManagerClient, look: Look, node: str, wanted: dict[str, str]) -> None:
    """Wait until all expected entities of a node have been discovered."""
    client.spin_until(lambda: wanted.items() <= of_node(look, node).items())


@pytest.mark.row("golden-nodes", "cm-parameter-services")
@pytest.mark.parametrize("node", NODES)
def test_each_node_has_the_parameter_services(client: ManagerClient, node: str) -> None:
    wanted = {f"/{node}/{name}": f"rcl_interfaces/srv/{kind}" for name, kind in PARAMETER_SERVICES.items()}
    expect(client, client.node.get_service_names_and_types_by_node, node, wanted)
    assert client.node.get_node_names().count(node) == 1


@pytest.mark.row("cm-services", "golden-manager-graph")
def test_manager_has_the_eleven_services_of_ros2_control(client: ManagerClient) -> None:
    wanted = {f"{MANAGER}/{name}": f"controller_manager_msgs/srv/{kind}" for name, kind in MANAGER_SERVICES.items()}
    assert len(wanted) == 11
    expect(client, client.node.get_service_names_and_types_by_node, MANAGER, wanted)


@pytest.mark.row("golden-manager-graph")
def test_manager_has_its_topics(client: ManagerClient) -> None:
    node = client.node
    activity = {f"{MANAGER}/activity": "controller_manager_msgs/msg/ControllerManagerActivity"}
    expect(client, node.get_publisher_names_and_types_by_node, MANAGER, activity)
    expect(client, node.get_subscriber_names_and_types_by_node, MANAGER, {"/robot_description": "std_msgs/msg/String"})
    report = {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
    expect(client, node.get_publisher_names_and_types_by_node, "robot_arm", report)


@pytest.mark.row("cm-statistics", "golden-manager-graph")
def test_manager_has_no_statistics_and_introspection_topics(client: ManagerClient) -> None:
    """In contrast to ros2_control, the timing of the loop is part of the diagnostics."""
    there = {f"{MANAGER}/activity", "/parameter_events", "/rosout"}
    client.spin_until(lambda: set(of_node(client.node.get_publisher_names_and_types_by_node, MANAGER)) == there)
    topics = [name for name, _ in client.node.get_topic_names_and_types()]
    assert not [name for name in topics if "statistics" in name or "introspection" in name]


@pytest.mark.row("golden-arm-graph")
def test_arm_has_its_action_service_and_topics(client: ManagerClient) -> None:
    node: Node = client.node
    action = {f"{ARM}/follow_joint_trajectory": "control_msgs/action/FollowJointTrajectory"}
    expect(client, partial(get_action_server_names_and_types_by_node, node), ARM, action)
    service = {f"{ARM}/query_state": "control_msgs/srv/QueryTrajectoryState"}
    expect(client, node.get_service_names_and_types_by_node, ARM, service)
    publishers = {
        f"{ARM}/controller_state": "control_msgs/msg/JointTrajectoryControllerState",
        f"{ARM}/transition_event": "lifecycle_msgs/msg/TransitionEvent",
    }
    expect(client, node.get_publisher_names_and_types_by_node, ARM, publishers)
    subscribers = {
        f"{ARM}/joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
        f"{ARM}/speed_scaling_input": "control_msgs/msg/SpeedScalingFactor",
    }
    expect(client, node.get_subscriber_names_and_types_by_node, ARM, subscribers)


def test_hand_subscribes_and_broadcaster_publishes(client: ManagerClient) -> None:
    node = client.node
    commands = {"/hand_controller/commands": "std_msgs/msg/Float64MultiArray"}
    expect(client, node.get_subscriber_names_and_types_by_node, "hand_controller", commands)
    states = {
        "/joint_states": "sensor_msgs/msg/JointState",
        "/dynamic_joint_states": "control_msgs/msg/DynamicJointState",
    }
    expect(client, node.get_publisher_names_and_types_by_node, "joint_state_broadcaster", states)


Quality = tuple[ReliabilityPolicy, DurabilityPolicy]


def quality(client: ManagerClient, endpoints: Callable[[str], list[TopicEndpointInfo]], topic: str) -> Quality:
    """Return the QoS of the only endpoint, after its discovery."""
    client.spin_until(lambda: endpoints(topic))
    (endpoint,) = endpoints(topic)
    return endpoint.qos_profile.reliability, endpoint.qos_profile.durability


@pytest.mark.row("golden-qos")
@pytest.mark.parametrize(
    ("topic", "offered"),
    [
        ("/joint_states", LATCHED),
        ("/dynamic_joint_states", LATCHED),
        (f"{ARM}/controller_state", LATCHED),
        (f"{MANAGER}/activity", LATCHED),
        ("/robot_description", LATCHED),
        ("/tf_static", LATCHED),
        ("/tf", RELIABLE),
        ("/diagnostics", RELIABLE),
        (f"{ARM}/transition_event", RELIABLE),
    ],
)
def test_publishers_are_reliable_and_states_are_latched(client: ManagerClient, topic: str, offered: Quality) -> None:
    assert quality(client, client.node.get_publishers_info_by_topic, topic) == offered


@pytest.mark.row("golden-qos")
@pytest.mark.parametrize(
    "topic", [f"{ARM}/joint_trajectory", f"{ARM}/speed_scaling_input", "/hand_controller/commands"]
)
def test_command_subscribers_accept_every_publisher(client: ManagerClient, topic: str) -> None:
    assert quality(client, client.node.get_subscriptions_info_by_topic, topic) == EVERY_PUBLISHER


@pytest.mark.row("golden-qos")
@pytest.mark.parametrize("reliability", [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
@pytest.mark.parametrize("durability", [DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE])
def test_every_publisher_discovers_the_hand(
    client: ManagerClient, reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> None:
    qos = QoSProfile(depth=1, reliability=reliability, durability=durability)
    publisher = client.node.create_publisher(Float64MultiArray, "/hand_controller/commands", qos)
    client.spin_until(lambda: publisher.get_subscription_count() == 1)
    client.node.destroy_publisher(publisher)
