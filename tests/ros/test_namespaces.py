"""Two stacks of the same arm in one domain: their nodes, frames, diagnostics and sockets stay separate."""

from collections.abc import Iterator

import pytest
from controller_manager_msgs.srv import ListControllers, SetHardwareComponentState
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from nodes.clients.stack_monitor import StackMonitor
from nodes.publishing import LATCHED
from servoloop.api.arm import Arm
from servoloop.recording.stream import LiveError, find_stack
from tests.ros.manager_client import ManagerClient, manager_client
from tests.ros.stack_process import running

LEFT = """
lab/left:
  controller_manager:
    ros__parameters:
      update_rate: 20
      joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
      arm_controller:
        type: joint_trajectory_controller/JointTrajectoryController
        node_options_args: [--ros-args, -r, "~/controller_state:=arm_state"]
      hand_controller: {type: forward_command_controller/ForwardCommandController}
  robot_state_publisher: {ros__parameters: {frame_prefix: l_}}
/**/arm_controller:
  ros__parameters:
    joints: [joint1, joint2, joint3, joint4, joint5, joint6]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
/**/hand_controller: {ros__parameters: {joints: [hand_right_joint], interface_name: position}}
"""
STATE = "/right/arm_controller/controller_state"
SHARED = {"/tf", "/tf_static", "/diagnostics", "/parameter_events", "/rosout"}
"""Topics that upstream's nodes have in every namespace."""


@pytest.fixture(scope="module")
def client(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ManagerClient]:
    """Run a stack in /lab/left and one in /right, and yield a client in the root namespace."""
    left, right = (tmp_path_factory.mktemp(name) for name in ("left", "right"))
    mock = ("--hardware", "mock", "--namespace")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        (left / "left.yaml").write_text(LEFT)
        with (
            running(left, *mock, "lab/left", "--controllers", str(left / "left.yaml")),
            running(right, *mock, "/right"),
            manager_client() as client,
        ):
            yield client


def test_all_nodes_topics_and_services_are_in_the_namespaces(client: ManagerClient) -> None:
    own = client.node.get_name()

    def nodes() -> set[tuple[str, str]]:
        found = client.node.get_node_names_and_namespaces()
        return {(name, namespace) for name, namespace in found if name != own}

    names = ("controller_manager", "arm_controller", "hand_controller", "joint_state_broadcaster", "robot_arm")
    wanted = {(name, namespace) for name in names for namespace in ("/lab/left", "/right")}
    client.spin_until(lambda: wanted <= nodes())
    assert {namespace for _, namespace in nodes()} == {"/lab/left", "/right"}

    def topics() -> set[str]:
        return {name for name, _ in client.node.get_topic_names_and_types()}

    def services() -> set[str]:
        found = {name for name, _ in client.node.get_service_names_and_types()}
        return {name for name in found if not name.startswith(f"/{own}/")}

    action = "/lab/left/arm_controller/follow_joint_trajectory/_action/send_goal"
    wanted_topics = {"/lab/left/joint_states", "/lab/left/arm_state", "/right/robot_description", STATE}
    client.spin_until(lambda: wanted_topics <= topics() and action in services(), instead=topics)
    assert f"/lab/left{STATE.removeprefix('/right')}" not in topics(), "it is renamed by node_options_args"
    outside = {name for name in topics() | services() if not name.startswith(("/lab/left/", "/right/"))}
    assert outside <= SHARED


def test_each_manager_answers_for_its_own_stack(client: ManagerClient) -> None:
    def states(namespace: str) -> dict[str, str]:
        found = client.call(ListControllers, f"{namespace}/controller_manager/list_controllers").controller
        return {one.name: one.state for one in found}

    before = states("/right")
    assert before["arm_controller"] == "active" and states("/lab/left") == before
    request = {"name": "robot_arm", "target_state": State(label="inactive")}
    service = "/lab/left/controller_manager/set_hardware_component_state"
    assert client.call(SetHardwareComponentState, service, **request).ok
    assert states("/lab/left")["arm_controller"] == "inactive" and states("/right") == before


def test_frames_and_statuses_carry_the_namespace(client: ManagerClient) -> None:
    with (
        client.hearing(TFMessage, "/tf", 10) as moving,
        client.hearing(DiagnosticArray, "/diagnostics", 10) as reports,
        client.hearing(JointState, "/right/joint_states", 10) as joints,
    ):
        frames: set[str] = set()

        def complete() -> bool:
            frames.update(transform.child_frame_id for message in moving for transform in message.transforms)
            return {"l_link1", "right/link1"} <= frames and len(reports) > 3 and bool(joints)

        client.spin_until(complete)
    assert all(frame.startswith(("l_", "right/")) for frame in frames)
    names = {status.name for message in reports for status in message.status}
    assert {"/lab/left/servoloop: control loop", "/right/servoloop: control loop"} <= names
    assert "joint1" in joints[0].name, "names of joints have no prefix"


def test_clients_of_a_namespace_receive_its_own_topics(client: ManagerClient) -> None:
    with client.hearing(String, "/right/robot_description", LATCHED) as described:
        client.spin_until(lambda: bool(described))
    node = Node("monitor", namespace="right")
    client.executor.add_node(node)
    monitor = StackMonitor(node, client.executor, "arm_controller")
    client.spin_until(lambda: bool(monitor.newest.loop and monitor.newest.position and monitor.newest.samples))
    assert not [name for name in monitor.newest.diagnostics if name.startswith("/")]
    client.executor.remove_node(node)
    node.destroy_node()


def test_programs_of_the_machine_find_a_stack_by_its_namespace(client: ManagerClient) -> None:
    assert find_stack(namespace="/right").name == "robot_arm in /right"
    with pytest.raises(LiveError, match=r"robot_arm in /lab/left .*robot_arm in /right .*--arm .*or --namespace"):
        find_stack("robot_arm")
    with pytest.raises(LiveError, match="no stack of robot_arm in the namespace / is running"):
        find_stack("robot_arm", "")
    with Arm.connect(namespace="lab/left") as arm:
        assert arm.name == "robot_arm"
