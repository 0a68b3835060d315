"""Topics and parameters of the broadcasters, as seen from another process."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import pytest
from control_msgs.msg import DynamicJointState
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from nodes.publishing import LATCHED
from tests.ros.stack_process import JOINTS, StackProcess, running
from tests.ros.topic_client import TopicClient, topic_client

HAND = "hand_right_joint"
CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    local_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    quiet_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    servo_states: {type: servoloop/ServoStateBroadcaster}
    hand_controller: {type: position_controllers/JointGroupPositionController}
    pair_controller: {type: position_controllers/JointGroupPositionController}
local_broadcaster:
  ros__parameters:
    use_local_topics: true
    joints: [joint2, joint1]
    interfaces: [velocity, position]
    extra_joints: [wheel]
    frame_id: tool
quiet_broadcaster:
  ros__parameters: {use_local_topics: true, publish_dynamic_joint_states: false}
servo_states:
  ros__parameters: {rate: 0.0, joints: [joint1], interfaces: [temperature, fault]}
hand_controller:
  ros__parameters: {joints: [hand_right_joint]}
pair_controller:
  ros__parameters: {joints: [joint1, joint2]}
robot_state_publisher:
  ros__parameters: {publish_frequency: 19.0}
"""


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("broadcasters")
    controllers = folder / "controllers.yaml"
    controllers.write_text(CONTROLLERS)
    with running(folder, "--hardware", "mock", "--controllers", str(controllers)) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[TopicClient]:
    with topic_client() as client:
        yield client


@pytest.mark.row("jsb-topics", "jsb-full", "jsb-order", "golden-joint-states")
def test_joint_states_match_ros2_control(client: TopicClient) -> None:
    message = client.first(JointState, "/joint_states")
    assert message.name == ["hand_left_joint", HAND, *JOINTS]
    assert message.header.frame_id == "base_link"
    assert all(math.isfinite(value) for value in (*message.position, *message.velocity))
    assert len(message.position) == len(message.velocity) == len(message.effort) == 8
    assert all(math.isnan(value) for value in message.effort)


@pytest.mark.row("moveit-states")
def test_moveit_finds_every_moving_joint(client: TopicClient) -> None:
    """The subscriber of MoveIt is reliable. The subscriber waits for all joints that are neither fixed nor mimic
    joints."""
    robot = ET.fromstring(client.first(String, "/robot_description", qos=LATCHED).data)
    joints = {joint.get("name") for joint in robot.findall("joint") if joint.get("type") != "fixed"}
    mimics = {joint.get("name") for joint in robot.findall("joint") if joint.find("mimic") is not None}
    assert joints - mimics == {HAND, *JOINTS}
    reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    for message in client.some(JointState, "/joint_states", 3, qos=reliable):
        assert joints - mimics <= set(message.name)
        assert len(message.name) == len(message.position)


@pytest.mark.row("jsb-topics", "jsb-order")
def test_dynamic_joint_states_list_the_interfaces_of_each_joint(client: TopicClient) -> None:
    message = client.first(DynamicJointState, "/dynamic_joint_states")
    assert message.joint_names == ["hand_left_joint", HAND, *JOINTS]
    assert message.header.frame_id == "base_link"
    assert {tuple(v.interface_names) for v in message.interface_values} == {("position", "velocity")}
    assert {len(v.values) for v in message.interface_values} == {2}


@pytest.mark.row("jsb-order", "jsb-extra", "jsb-full")
def test_local_broadcaster_publishes_the_configured_joints(client: TopicClient) -> None:
    """The joints are in the order of the parameters, followed by the extra joints with zeros."""
    client.send("pair_controller", 0.1, -0.2)
    client.arrives(joint1=0.1, joint2=-0.2)
    message = client.first(JointState, "/local_broadcaster/joint_states")
    assert message.name == ["joint2", "joint1", "wheel"]
    assert message.header.frame_id == "tool"
    assert list(message.position) == pytest.approx([-0.2, 0.1, 0.0])
    assert list(message.velocity) == [0.0, 0.0, 0.0]
    assert list(message.effort) == pytest.approx([math.nan, math.nan, 0.0], nan_ok=True)
    dynamic = client.first(DynamicJointState, "/local_broadcaster/dynamic_joint_states")
    assert dynamic.joint_names == ["joint2", "joint1", "wheel"]
    assert [list(v.interface_names) for v in dynamic.interface_values] == [
        ["velocity", "position"],
        ["velocity", "position"],
        ["position", "velocity", "effort"],
    ]
    shown = [list(v.values) for v in dynamic.interface_values]
    assert shown == [pytest.approx([0.0, -0.2]), pytest.approx([0.0, 0.1]), [0.0, 0.0, 0.0]]


def test_dynamic_joint_states_can_be_switched_off(client: TopicClient) -> None:
    client.spin_until(lambda: bool(client.node.get_publishers_info_by_topic("/quiet_broadcaster/joint_states")))
    client.spin_until(lambda: bool(client.node.get_publishers_info_by_topic("/dynamic_joint_states")))
    assert not client.node.get_publishers_info_by_topic("/quiet_broadcaster/dynamic_joint_states")


def test_servo_states_are_published_to_subscribers(client: TopicClient) -> None:
    message = client.first(DynamicJointState, "/servo_states/dynamic_joint_states")
    assert message.joint_names == ["joint1"]
    (values,) = message.interface_values
    assert list(values.interface_names) == ["temperature", "fault"]
    assert math.isnan(values.values[0])  # the mock has no servos
    assert values.values[1] == 0.0


@pytest.mark.row("golden-qos")
@pytest.mark.parametrize("topic", ["/joint_states", "/dynamic_joint_states", "/tf_static", "/robot_description"])
def test_newest_state_is_latched_for_late_subscribers(client: TopicClient, topic: str) -> None:
    client.spin_until(lambda: bool(client.node.get_publishers_info_by_topic(topic)))
    (publisher,) = client.node.get_publishers_info_by_topic(topic)
    assert publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
    assert publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.row("golden-qos")
def test_hand_accepts_commands_of_every_publisher(client: TopicClient) -> None:
    client.spin_until(lambda: bool(client.node.get_subscriptions_info_by_topic("/hand_controller/commands")))
    (subscriber,) = client.node.get_subscriptions_info_by_topic("/hand_controller/commands")
    assert subscriber.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert subscriber.qos_profile.durability is DurabilityPolicy.VOLATILE


@pytest.mark.parametrize(
    ("node", "name", "value", "reason"),
    [
        ("joint_state_broadcaster", "frame_id", "x", "parameter 'frame_id' cannot be set because it is read-only"),
        ("joint_state_broadcaster", "map_interface_to_joint_state.effort", "x", "because it is read-only"),
        ("hand_controller", "command_timeout", 1.0, "parameter 'command_timeout' cannot be set because it is read"),
        ("servo_states", "rate", -1.0, "must be at least 0"),
        ("servo_states", "rate", 5.0, ""),
    ],
)
def test_parameters_are_read_only_or_checked(
    client: TopicClient, node: str, name: str, value: Any, reason: str
) -> None:
    answer = client.put(f"/{node}", name, value)
    assert reason in answer
    assert bool(reason) == bool(answer)


@pytest.mark.row("rsp-parameters")
def test_robot_state_publisher_starts_with_parameters_of_the_controllers_file(client: TopicClient) -> None:
    names = ("publish_frequency", "frame_prefix", "ignore_timestamp")
    assert client.get("/robot_state_publisher", *names) == [19.0, "", False]
