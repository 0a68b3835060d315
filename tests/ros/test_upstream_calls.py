"""Calls of the ros2_control command-line tools, which were recorded from the tools and are repeated with our client."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from control_msgs.msg import DynamicJointState, JointTrajectoryControllerState
from rclpy.duration import Duration
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

from nodes.publishing import LATCHED
from tests.ros.manager_client import MANAGER, ManagerClient, manager_client
from tests.ros.stack_process import StackProcess, running

TRAJECTORY = "joint_trajectory_controller/JointTrajectoryController"
HAND = """
hand:
  ros__parameters:
    type: forward_command_controller/ForwardCommandController
    joints: [hand_right_joint]
    interface_name: position
"""
ARM = f"""
arm:
  ros__parameters:
    type: {TRAJECTORY}
    joints: [joint1, joint2]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    constraints: {{goal_time: 1.0, joint1: {{goal: 0.1, trajectory: 0.2}}}}
"""
FINER = """
arm:
  ros__parameters:
    constraints.stopped_velocity_tolerance: 0.5
    constraints: {joint1: {goal: 0.05}}
"""
LONG_AFTER = Duration(seconds=2)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("upstream")
    for name, text in (("hand", HAND), ("brief", HAND.replace("hand:", "brief:")), ("arm", ARM), ("finer", FINER)):
        (folder / f"{name}.yaml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def stack(ros_domain: int, files: Path) -> Iterator[StackProcess]:
    with running(files, "--hardware", "mock") as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[ManagerClient]:
    with manager_client() as client:
        yield client


def spawn(client: ManagerClient, name: str, files: list[Path], arguments: list[str] | None = None) -> None:
    """Spawn a controller as ``spawner NAME --param-file … --controller-ros-args … --inactive`` does."""
    kind = TRAJECTORY if name == "arm" else "forward_command_controller/ForwardCommandController"
    settings = {"node_options_args": arguments, "params_file": [str(path) for path in files], "type": kind}
    for key, value in settings.items():
        assert not value or client.set_from_text(MANAGER, f"{name}.{key}", str(value))
    assert client.load(name)
    assert client.configure(name)


def serve(client: ManagerClient, duration: Duration) -> None:
    """Spin for some time."""
    clock = client.node.get_clock()
    end = clock.now() + duration
    client.spin_until(lambda: clock.now() > end)


@pytest.mark.parametrize("flag", [[], ["--ros-args"]])
def test_node_arguments_rename_topics_and_set_parameters(
    client: ManagerClient, stack: StackProcess, files: Path, flag: list[str]
) -> None:
    arguments = [*flag, "-r", "hand/commands:=/fingers", "-p", "joints:=[hand_right_joint,joint6]", "-p", "other:x:=1"]
    spawn(client, "hand", [files / "hand.yaml"], arguments)
    try:
        assert client.listed()["hand"].required_command_interfaces == ["hand_right_joint/position", "joint6/position"]
        assert client.get("/hand", "joints") == [["hand_right_joint", "joint6"]]
        client.spin_until(lambda: client.node.count_subscribers("/fingers"))
    finally:
        assert client.unload("hand")
    assert "deprecated" not in stack.words


def test_invalid_yaml_in_a_node_argument_is_refused_with_a_reason(
    client: ManagerClient, stack: StackProcess, files: Path
) -> None:
    for key, value in (("node_options_args", ["-p", "joints:=[joint1"]), ("params_file", [str(files / "arm.yaml")])):
        assert client.set_from_text(MANAGER, f"arm.{key}", str(value))
    assert client.set_from_text(MANAGER, "arm.type", TRAJECTORY)
    assert not client.load("arm")
    assert "arm: the value in the argument '-p joints:=[joint1' is not valid YAML" in stack.words


def test_node_arguments_accept_integers_for_numbers(client: ManagerClient, files: Path) -> None:
    spawn(client, "arm", [files / "arm.yaml"], ["-p", "constraints.goal_time:=2"])
    try:
        assert client.get("/arm", "constraints.goal_time", "constraints.joint1.goal") == [2.0, 0.1]
    finally:
        assert client.unload("arm")


def test_second_parameter_file_changes_only_its_parameters(client: ManagerClient, files: Path) -> None:
    spawn(client, "arm", [files / "arm.yaml", files / "finer.yaml"], ["--ros-args"])
    names = ("goal_time", "stopped_velocity_tolerance", "joint1.goal", "joint1.trajectory")
    try:
        assert client.get("/arm", *(f"constraints.{name}" for name in names)) == [1.0, 0.5, 0.05, 0.2]
    finally:
        assert client.unload("arm")


def test_unloaded_controller_leaves_nothing_behind(client: ManagerClient, files: Path) -> None:
    def left() -> list[str]:
        graph = (*client.node.get_service_names_and_types(), *client.node.get_topic_names_and_types())
        return [name for name, _ in graph if name.startswith("/brief/")]

    spawn(client, "brief", [files / "brief.yaml"])
    client.spin_until(lambda: {"/brief/get_type_description", "/brief/commands"} <= set(left()))
    assert client.unload("brief")
    client.spin_until(lambda: not left())


@pytest.mark.parametrize(
    ("kind", "topic"),
    [
        (DynamicJointState, "/dynamic_joint_states"),
        (JointTrajectoryControllerState, "/arm_controller/controller_state"),
    ],
)
def test_late_subscriber_receives_no_old_state(client: ManagerClient, kind: type, topic: str) -> None:
    """These topics are published only if they have subscribers, so the latest message may be old."""
    clock = client.node.get_clock()
    with client.hearing(kind, topic, LATCHED) as messages:
        client.spin_until(lambda: messages)
    serve(client, LONG_AFTER)
    began = clock.now()
    with client.hearing(kind, topic, LATCHED) as messages:
        client.spin_until(lambda: messages)
    assert began - Time.from_msg(messages[0].header.stamp) < Duration(seconds=1)


def test_no_transform_is_published_without_a_measurement(client: ManagerClient) -> None:
    """ROS 2's robot_state_publisher behaves in the same way, because it receives no joint states."""
    with client.hearing(TFMessage, "/tf") as messages:
        client.spin_until(lambda: messages)
        for label in ("inactive", "unconfigured", "inactive", "active"):
            client.set_hardware(label)
            received = len(messages)
            serve(client, Duration(seconds=0.5))
            assert (len(messages) > received + 2) == (label != "unconfigured")
        assert all(message.transforms for message in messages)
