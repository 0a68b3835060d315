"""The robot state publisher, as seen from another process: link poses and publishing rate."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import pytest
from geometry_msgs.msg import Transform
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from nodes.publishing import LATCHED
from servoloop.stack.shipped_files import URDF
from tests.ros.stack_process import JOINTS, StackProcess, running
from tests.ros.topic_client import EVERY, TopicClient, topic_client

PERIOD_S = 0.05
LINKS = "/robot_state_publisher"
CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    local_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    hand_controller: {type: position_controllers/JointGroupPositionController}
    base_controller: {type: position_controllers/JointGroupPositionController}
local_broadcaster: {ros__parameters: {use_local_topics: true, joints: [joint1], interfaces: [position]}}
hand_controller: {ros__parameters: {joints: [hand_right_joint]}}
base_controller: {ros__parameters: {joints: [joint1]}}
"""
CELL_CAMERA = (("base_link", "camera_link"), ("camera_link", "camera_optical_frame"))
"""Fixed frames of the camera beside the arm."""
MORE = """
<link name="camera"/>
<joint name="camera_mount" type="fixed">
  <parent link="link5"/><child link="camera"/><origin xyz="0.01 0.02 0.03" rpy="0 0 1.5707963267948966"/>
</joint>
<link name="pointer"/>
<joint name="pointer_joint" type="continuous">
  <parent link="base_link"/><child link="pointer"/><axis xyz="0 0 1"/>
  <mimic joint="joint1" multiplier="-2" offset="0.5"/>
</joint>
</robot>
"""
"""A fixed link and a link that mimics joint1. The hardware and the joint states do not contain these joints."""
MOVING = {f"link{i}" for i in range(1, 6)} | {"gripper_base_link", "hand_right_link", "hand_left_link", "pointer"}


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("transforms")
    controllers, urdf = folder / "controllers.yaml", folder / "robot.urdf"
    controllers.write_text(CONTROLLERS)
    urdf.write_text(URDF.read_text().replace("</robot>", MORE))
    with running(folder, "--hardware", "mock", "--controllers", str(controllers), "--urdf", str(urdf)) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[TopicClient]:
    with topic_client() as client:
        yield client


@pytest.fixture
def upstreams(client: TopicClient) -> Iterator[None]:
    """Restore the default parameters after the test."""
    yield
    for name, value in (("publish_frequency", 20.0), ("frame_prefix", ""), ("ignore_timestamp", False)):
        assert client.put(LINKS, name, value) == ""


def frames(message: TFMessage) -> set[tuple[str, str]]:
    """Return pairs of parent and child frames."""
    return {(t.header.frame_id, t.child_frame_id) for t in message.transforms}


def placed(message: TFMessage, link: str) -> Transform:
    (transform,) = (t.transform for t in message.transforms if t.child_frame_id == link)
    return transform


def shift(transform: Transform) -> tuple[float, float, float]:
    return transform.translation.x, transform.translation.y, transform.translation.z


def turn(transform: Transform) -> tuple[float, float, float, float]:
    rotation = transform.rotation
    return rotation.x, rotation.y, rotation.z, rotation.w


def about_z(angle_rad: float) -> Any:
    return pytest.approx((0.0, 0.0, math.sin(angle_rad / 2.0), math.cos(angle_rad / 2.0)))


def stamps_ns(messages: Sequence[JointState | TFMessage]) -> list[int]:
    """Return the stamps of all transforms."""
    headers = [m.transforms[0].header if isinstance(m, TFMessage) else m.header for m in messages]
    return [header.stamp.sec * 1_000_000_000 + header.stamp.nanosec for header in headers]


@pytest.mark.row("rsp-topics")
def test_late_subscriber_receives_the_exact_description(client: TopicClient, stack: StackProcess) -> None:
    latched = client.first(String, "/robot_description", qos=LATCHED).data
    assert latched == URDF.read_text().replace("</robot>", MORE)
    assert ET.fromstring(latched).get("name") == "robot_arm"


@pytest.mark.row("rsp-topics")
def test_moving_links_are_in_tf_and_fixed_links_in_tf_static(client: TopicClient) -> None:
    moving = client.first(TFMessage, "/tf")
    fixed = client.first(TFMessage, "/tf_static", qos=LATCHED)
    assert {child for _, child in frames(moving)} == MOVING
    assert ("base_link", "link1") in frames(moving)
    assert frames(fixed) == {("link5", "camera"), *CELL_CAMERA}
    assert shift(placed(fixed, "camera")) == pytest.approx((0.01, 0.02, 0.03))
    assert turn(placed(fixed, "camera")) == about_z(math.pi / 2.0)


@pytest.mark.row("rsp-topics", "rsp-mimic")
def test_links_follow_their_joints_and_mimics(client: TopicClient) -> None:
    client.send("base_controller", 0.4)
    client.send("hand_controller", 0.02)
    client.arrives(joint1=0.4, hand_right_joint=0.02, hand_left_joint=0.02)
    message = client.first(TFMessage, "/tf")
    assert shift(placed(message, "link1")) == pytest.approx((0.0, 0.0, 0.1))
    assert turn(placed(message, "link1")) == about_z(0.4)
    assert turn(placed(message, "pointer")) == about_z(-2.0 * 0.4 + 0.5)
    assert shift(placed(message, "hand_right_link")) == pytest.approx((-0.05 + 0.02, 0.0, 0.15))
    assert shift(placed(message, "hand_left_link")) == pytest.approx((0.05 - 0.02, 0.0, 0.15))
    assert "pointer_joint" not in client.first(JointState, "/joint_states").name


@pytest.mark.row("rsp-states")
def test_joint_states_of_other_publishers_are_ignored(client: TopicClient) -> None:
    """In contrast, the node of ROS 2 uses all messages on the topic."""
    client.send("base_controller", 0.2)
    client.arrives(joint1=0.2)
    publisher = client.node.create_publisher(JointState, "/joint_states", 10)
    foreign = JointState(name=list(JOINTS), position=[1.0] * len(JOINTS))
    with client.hearing(JointState, "/joint_states", EVERY) as states, client.hearing(TFMessage, "/tf", EVERY) as links:
        client.spin_until(lambda: publisher.get_subscription_count() > 0 and bool(links))
        for _ in range(10):
            foreign.header.stamp = client.node.get_clock().now().to_msg()
            publisher.publish(foreign)
            client.spin_until(lambda: foreign in states)
        told = len(links)
        client.spin_until(lambda: len(links) > told + 5)
    client.node.destroy_publisher(publisher)
    assert [turn(placed(message, "link1")) for message in links] == [about_z(0.2)] * len(links)
    listeners = client.node.get_subscriptions_info_by_topic("/joint_states")
    assert "robot_state_publisher" not in {listener.node_name for listener in listeners}


@pytest.mark.row("rsp-parameters")
def test_parameters_match_robot_state_publisher(client: TopicClient) -> None:
    names = ("robot_description", "publish_frequency", "frame_prefix", "ignore_timestamp")
    description, *others = client.get(LINKS, *names)
    assert description == client.first(String, "/robot_description", qos=LATCHED).data
    assert others == [20.0, "", False]


@pytest.mark.row("rsp-parameters")
@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("robot_description", "<robot/>", "restart the stack with the other URDF"),
        ("publish_frequency", 0.0, "publish_frequency: must be above 0"),
        ("publish_frequency", 1001.0, "publish_frequency: must be 0 to 1000 Hz, not 1001"),
    ],
)
def test_invalid_parameter_is_rejected_with_a_reason(client: TopicClient, name: str, value: Any, words: str) -> None:
    assert words in client.put(LINKS, name, value)


def heard(client: TopicClient, count: int) -> tuple[list[int], list[int]]:
    """Return the stamps of a number of link transforms, and those of the joint states in the same period."""
    with client.hearing(JointState, "/joint_states", EVERY) as states, client.hearing(TFMessage, "/tf", EVERY) as links:
        client.spin_until(lambda: bool(states) and len(links) >= 2)  # After a change the second transform comes early.
        links.clear()
        client.spin_until(lambda: len(links) >= count and stamps_ns(states)[-1] >= stamps_ns(links)[-1])
        shown, measured = stamps_ns(links), stamps_ns(states)
    return shown, [stamp for stamp in measured if shown[0] <= stamp <= shown[-1]]


@pytest.mark.row("rsp-parameters")
@pytest.mark.parametrize(("frequency_hz", "every"), [(20.0, 1), (5.0, 4), (1000.0, 1)])
def test_links_are_published_at_the_frequency_but_not_faster_than_states(
    client: TopicClient, upstreams: None, frequency_hz: float, every: int
) -> None:
    assert client.put(LINKS, "publish_frequency", frequency_hz) == ""
    shown, measured = heard(client, 8)
    assert set(shown[1:-1]) <= set(measured)
    assert len(measured) <= 1 + every * (len(shown) - 1) + 2
    assert min(after - before for before, after in pairwise(shown)) > 0
    assert (shown[-1] - shown[0]) * 1e-9 > 0.9 * every * PERIOD_S * (len(shown) - 1)


@pytest.mark.row("rsp-parameters")
def test_ignore_timestamp_publishes_every_state(client: TopicClient, upstreams: None) -> None:
    assert client.put(LINKS, "publish_frequency", 5.0) == ""
    assert client.put(LINKS, "ignore_timestamp", True) == ""
    shown, measured = heard(client, 10)
    assert set(measured) <= set(shown)
    assert len(measured) >= 9


@pytest.mark.row("rsp-parameters")
def test_frame_prefix_applies_to_all_links_at_run_time(client: TopicClient, upstreams: None) -> None:
    assert client.put(LINKS, "frame_prefix", "left/") == ""

    def prefixed(message: TFMessage) -> bool:
        return all(frame.startswith("left/") for pair in frames(message) for frame in pair)

    assert ("left/base_link", "left/link1") in frames(client.first(TFMessage, "/tf", prefixed))
    fixed = {("left/link5", "left/camera"), *((f"left/{parent}", f"left/{child}") for parent, child in CELL_CAMERA)}
    assert frames(client.first(TFMessage, "/tf_static", prefixed, LATCHED)) == fixed
    # The broadcaster with local topics publishes only a part of the arm and does not affect the transforms.
    assert {len(m.transforms) for m in client.some(TFMessage, "/tf", 10, prefixed)} == {len(MOVING)}
    assert client.put(LINKS, "frame_prefix", "") == ""
    client.first(TFMessage, "/tf", lambda m: ("base_link", "link1") in frames(m))
