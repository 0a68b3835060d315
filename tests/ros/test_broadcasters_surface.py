"""Broadcasters, the hand's commands and the robot state publisher, as a client in another process meets them."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

import rclpy
from control_msgs.msg import DynamicJointState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from tf2_msgs.msg import TFMessage

from servoloop.files import URDF
from tests.ros.stack_process import JOINTS, PATIENCE_S, StackProcess, running, until

pytestmark = pytest.mark.ros

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
local_broadcaster:
  ros__parameters:
    use_local_topics: true
    joints: [joint2, joint1]
    interfaces: [position]
    extra_joints: [wheel]
    frame_id: tool
quiet_broadcaster:
  ros__parameters: {use_local_topics: true, publish_dynamic_joint_states: false}
servo_states:
  ros__parameters: {rate: 0.0, joints: [joint1], interfaces: [temperature, fault]}
hand_controller:
  ros__parameters: {joints: [hand_right_joint]}
robot_state_publisher:
  ros__parameters: {publish_frequency: 19.0}
"""
CAMERA = """
<link name="camera"/>
<joint name="camera_mount" type="fixed"><parent link="link6"/><child link="camera"/></joint>
</robot>
"""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Client:
    """A node of the test's own."""

    def __init__(self) -> None:
        self.node = Node("onlooker")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def spin_until(self, ready: Callable[[], bool]) -> None:
        until(lambda: self._executor.spin_once(timeout_sec=0.1) or ready())

    def first(self, kind: Any, topic: str, wanted: Callable[[Any], bool] = lambda m: True, qos: Any = 10) -> Any:
        """The first message of which ``wanted`` holds."""
        return self.some(kind, topic, 1, wanted, qos)[0]

    def some(
        self, kind: Any, topic: str, count: int, wanted: Callable[[Any], bool] = lambda m: True, qos: Any = 10
    ) -> list[Any]:
        """The first messages of which ``wanted`` holds."""
        seen: list[Any] = []
        subscription = self.node.create_subscription(kind, topic, seen.append, qos)
        self.spin_until(lambda: len(list(filter(wanted, seen))) >= count)
        self.node.destroy_subscription(subscription)
        return list(filter(wanted, seen))

    def call(self, kind: Any, service: str, request: Any) -> Any:
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(PATIENCE_S)
        future = client.call_async(request)
        self._executor.spin_until_future_complete(future, timeout_sec=PATIENCE_S)
        return future.result()

    def set(self, node: str, **values: Any) -> list[str]:
        """Set parameters; why each is refused, or ''."""
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        answer = self.call(SetParameters, f"/{node}/set_parameters", SetParameters.Request(parameters=parameters))
        return [result.reason for result in answer.results]


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("broadcasters")
    controllers = folder / "controllers.yaml"
    controllers.write_text(CONTROLLERS)
    urdf = folder / "robot.urdf"
    urdf.write_text(URDF.read_text().replace("</robot>", CAMERA))
    with running(folder, "--hardware", "mock", "--controllers", str(controllers), "--urdf", str(urdf)) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[Client]:
    rclpy.init()
    client = Client()
    yield client
    client.node.destroy_node()
    rclpy.try_shutdown()


def test_joint_states_are_upstreams(client: Client) -> None:
    message = client.first(JointState, "/joint_states")
    assert message.name == ["hand_left_joint", HAND, *JOINTS]
    assert message.header.frame_id == "base_link"
    assert message.header.stamp.sec > 0
    assert all(math.isfinite(value) for value in (*message.position, *message.velocity))
    assert len(message.position) == len(message.velocity) == len(message.effort) == 8
    assert all(math.isnan(value) for value in message.effort)


def test_dynamic_joint_states_have_each_joints_own_interfaces(client: Client) -> None:
    message = client.first(DynamicJointState, "/dynamic_joint_states")
    assert message.joint_names == ["hand_left_joint", HAND, *JOINTS]
    assert message.header.frame_id == "base_link"
    assert {tuple(v.interface_names) for v in message.interface_values} == {("position", "velocity")}
    assert {len(v.values) for v in message.interface_values} == {2}


def test_a_local_broadcaster_shows_what_it_was_asked_for(client: Client) -> None:
    message = client.first(JointState, "/local_broadcaster/joint_states")
    assert message.name == ["joint2", "joint1", "wheel"]
    assert message.header.frame_id == "tool"
    assert all(math.isfinite(value) for value in message.position)
    assert [math.isnan(value) for value in message.velocity] == [True, True, False]
    dynamic = client.first(DynamicJointState, "/local_broadcaster/dynamic_joint_states")
    assert dynamic.joint_names == ["joint2", "joint1", "wheel"]
    assert [list(v.interface_names) for v in dynamic.interface_values] == [
        ["position"],
        ["position"],
        ["position", "velocity", "effort"],
    ]
    assert list(dynamic.interface_values[2].values) == [0.0, 0.0, 0.0]


def test_dynamic_joint_states_can_be_switched_off(client: Client) -> None:
    client.spin_until(lambda: bool(client.node.get_publishers_info_by_topic("/quiet_broadcaster/joint_states")))
    client.spin_until(lambda: bool(client.node.get_publishers_info_by_topic("/dynamic_joint_states")))
    assert not client.node.get_publishers_info_by_topic("/quiet_broadcaster/dynamic_joint_states")


def test_servo_states_are_there_for_those_who_listen(client: Client) -> None:
    message = client.first(DynamicJointState, "/servo_states/dynamic_joint_states")
    assert message.joint_names == ["joint1"]
    (values,) = message.interface_values
    assert list(values.interface_names) == ["temperature", "fault"]
    assert math.isnan(values.values[0])  # the mock has no servos
    assert values.values[1] == 0.0


@pytest.mark.parametrize("topic", ["/joint_states", "/dynamic_joint_states", "/tf_static", "/robot_description"])
def test_the_newest_state_waits_for_late_listeners(client: Client, topic: str) -> None:
    (publisher,) = client.node.get_publishers_info_by_topic(topic)
    assert publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
    assert publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL


def test_the_hand_listens_to_every_publisher(client: Client) -> None:
    (subscriber,) = client.node.get_subscriptions_info_by_topic("/hand_controller/commands")
    assert subscriber.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert subscriber.qos_profile.durability is DurabilityPolicy.VOLATILE


def _hand(message: JointState) -> float:
    return float(message.position[message.name.index(HAND)])


def test_the_hand_does_what_is_a_command_and_drops_what_is_none(client: Client, stack: StackProcess) -> None:
    publisher = client.node.create_publisher(Float64MultiArray, "/hand_controller/commands", 10)
    client.spin_until(lambda: publisher.get_subscription_count() == 1)

    def send(*values: float) -> None:
        publisher.publish(Float64MultiArray(data=list(values)))

    send(0.02)
    state = client.first(JointState, "/joint_states", lambda m: abs(_hand(m) - 0.02) < 1e-6)
    assert state.position[state.name.index("hand_left_joint")] == _hand(state)  # it mimics the right one

    def finger(name: str) -> tuple[float, float, float]:
        message = client.first(TFMessage, "/tf", lambda m: name in {t.child_frame_id for t in m.transforms})
        (place,) = (t.transform.translation for t in message.transforms if t.child_frame_id == name)
        return place.x, place.y, place.z

    assert finger("hand_right_link") == pytest.approx((-0.05 + 0.02, 0.0, 0.15))
    assert finger("hand_left_link") == pytest.approx((0.05 - 0.02, 0.0, 0.15))
    send(0.01, 0.03)
    until(lambda: "command size (2) does not match number of interfaces (1): dropped, send one" in stack.words)
    for number, value in enumerate((math.nan, math.inf, -math.inf), start=1):
        send(value)
        until(lambda n=number: stack.words.count("Non-finite value received. Dropping message") >= n)
    send()
    assert _hand(client.first(JointState, "/joint_states")) == pytest.approx(0.02)
    send(0.04)
    client.first(JointState, "/joint_states", lambda m: abs(_hand(m) - 0.04) < 1e-6)
    send(9.0)
    client.first(JointState, "/joint_states", lambda m: abs(_hand(m) - 0.05) < 1e-6)
    send(-0.01)
    client.first(JointState, "/joint_states", lambda m: abs(_hand(m)) < 1e-6)


@pytest.mark.parametrize(
    ("node", "values", "reason"),
    [
        ("joint_state_broadcaster", {"frame_id": "x"}, "parameter 'frame_id' cannot be set because it is read-only"),
        ("joint_state_broadcaster", {"map_interface_to_joint_state.effort": "x"}, "because it is read-only"),
        ("hand_controller", {"command_timeout": 1.0}, "parameter 'command_timeout' cannot be set because it is read"),
        ("servo_states", {"rate": -1.0}, "greater than or equal to 0"),
        ("servo_states", {"rate": 5.0}, ""),
    ],
)
def test_parameters_are_read_only_as_upstream_or_checked(
    client: Client, node: str, values: dict[str, Any], reason: str
) -> None:
    (answer,) = client.set(node, **values)
    assert reason in answer
    assert bool(reason) == bool(answer)


# robot_state_publisher


def _frames(message: TFMessage) -> set[tuple[str, str]]:
    return {(t.header.frame_id, t.child_frame_id) for t in message.transforms}


def test_the_description_is_latched(client: Client) -> None:
    assert "<ros2_control" in client.first(String, "/robot_description", qos=LATCHED).data


def test_its_parameters_are_upstreams_and_begin_as_the_controllers_file_says(client: Client) -> None:
    names = ["robot_description", "publish_frequency", "frame_prefix", "ignore_timestamp"]
    request = GetParameters.Request(names=names)
    description, frequency, prefix, ignore = client.call(
        GetParameters, "/robot_state_publisher/get_parameters", request
    ).values
    assert "<ros2_control" in description.string_value
    assert (frequency.double_value, prefix.string_value, ignore.bool_value) == (19.0, "", False)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"robot_description": "<robot/>"}, "end it and start it with the other URDF"),
        ({"publish_frequency": 0.0}, "publish_frequency: Input should be greater than 0"),
        ({"publish_frequency": 1001.0}, "publish_frequency: Input should be less than or equal to 1000"),
    ],
)
def test_what_it_cannot_do_is_refused_in_words(client: Client, values: dict[str, Any], words: str) -> None:
    (reason,) = client.set("robot_state_publisher", **values)
    assert words in reason


def test_it_shows_moving_links_mimics_among_them_and_fixed_ones(client: Client) -> None:
    moving = _frames(client.first(TFMessage, "/tf"))
    fixed = _frames(client.first(TFMessage, "/tf_static", qos=LATCHED))
    assert len(moving) == 8  # six joints and two fingers
    assert ("base_link", "link1") in moving
    assert fixed == {("link6", "camera")}


def test_a_frame_prefix_acts_on_all_links_while_it_runs(client: Client) -> None:
    assert (
        client.set("robot_state_publisher", frame_prefix="left/", ignore_timestamp=True, publish_frequency=5.0)
        == [""] * 3
    )

    def prefixed(message: TFMessage) -> bool:
        return all(frame.startswith("left/") for pair in _frames(message) for frame in pair)

    assert ("left/base_link", "left/link1") in _frames(client.first(TFMessage, "/tf", prefixed))
    assert _frames(client.first(TFMessage, "/tf_static", prefixed, LATCHED)) == {("left/link6", "left/camera")}
    # The broadcasters with topics of their own show parts of the arm, and move no links.
    assert {len(m.transforms) for m in client.some(TFMessage, "/tf", 10, prefixed)} == {8}
    assert client.set("robot_state_publisher", frame_prefix="") == [""]
    client.first(TFMessage, "/tf", lambda m: ("base_link", "link1") in _frames(m))
