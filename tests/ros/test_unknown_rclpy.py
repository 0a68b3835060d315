"""With an unknown version of rclpy, the stack uses no patch, logs one warning and otherwise works normally."""

import signal
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from control_msgs.action import FollowJointTrajectory
from controller_manager_msgs.srv import ListHardwareComponents
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from tests.ros.manager_client import MANAGER, ManagerClient, manager_client
from tests.ros.stack_process import PICK, READY, StackProcess, arm_client, running

HAND = "hand_right_joint"


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("unknown")
    with running(folder, "--hardware", "mock", module="tests.ros.unknown_rclpy") as stack:
        yield stack


def test_one_warning_lists_the_limitations(stack: StackProcess) -> None:
    (warning,) = [line for line in stack.words.splitlines() if "plain rclpy" in line]
    assert warning.startswith("WARNING servoloop.nodes: rclpy 7.1.99 is not supported (supported: 7.1.5)")
    for loss in ("block the control loop for 0.1 s", "1 to 1.5 ms", "get_type_description"):
        assert loss in warning


def test_goals_are_reached_and_canceled(stack: StackProcess) -> None:
    with arm_client() as client:
        for pose in (READY, PICK):
            response: Any = client.wait(client.send(pose, seconds=1))
            assert response.result.error_code == FollowJointTrajectory.Result.SUCCESSFUL, response.result.error_string
        far: Any = client.send(READY, seconds=20)
        canceled: Any = client.wait(client.handle.cancel_goal_async())
        assert len(canceled.goals_canceling) == 1
        assert client.wait(far).status == 5  # type: ignore[attr-defined]  # STATUS_CANCELED


def test_every_cycle_is_published_and_the_hand_follows(stack: StackProcess) -> None:
    with manager_client() as client, client.hearing(JointState, "/joint_states") as states:
        hand = client.node.create_publisher(Float64MultiArray, "/hand_controller/commands", 10)

        def obeyed() -> bool:
            # The first message may arrive before the stack has discovered its publisher.
            hand.publish(Float64MultiArray(data=[0.04]))
            return bool(states) and position(states[-1], HAND) > 0.03

        client.spin_until(obeyed)
        client.spin_until(lambda: len(states) > 40)
        stamps_s = [s.header.stamp.sec + s.header.stamp.nanosec * 1e-9 for s in states]
        steps_s = [after - before for before, after in pairwise(stamps_s)]
        assert max(steps_s) < 0.09 and min(steps_s) > 0.01  # 20 Hz without skipped cycles
        hand.publish(Float64MultiArray(data=[0.0]))


def position(message: JointState, joint: str) -> float:
    return float(message.position[list(message.name).index(joint)])


def test_services_change_the_loaded_controllers(stack: StackProcess) -> None:
    with manager_client() as client:
        before = client.states()
        assert set(before.values()) == {"active"}
        assert client.switch((), ["hand_controller"])[0] and client.cleanup("hand_controller")
        assert client.unload("hand_controller")
        assert "hand_controller" not in client.states()
        client.spin_until(lambda: "hand_controller" not in client.node.get_node_names())
        assert client.load("hand_controller") and client.configure("hand_controller")
        assert client.switch(["hand_controller"])[0]
        assert client.states() == before
        assert "hand_controller" in client.node.get_node_names()
        assert "/hand_controller/commands" in dict(client.node.get_topic_names_and_types())
        components = client.call(ListHardwareComponents, f"{MANAGER}/list_hardware_components").component
        assert [c.state.label for c in components] == ["active"]
        refused(client)


def refused(client: ManagerClient) -> None:
    """Read-only parameters keep their values, and other parameters are checked."""
    assert "read-only" in client.put("/arm_controller", "joints", ["a"])
    assert "not declared" in client.put("/arm_controller", "joint", "a")
    assert client.get(MANAGER, "update_rate") == [20]


def test_diagnostics_are_published_once_per_second(stack: StackProcess) -> None:
    with manager_client() as client, client.hearing(DiagnosticArray, "/diagnostics") as reports:
        client.spin_until(lambda: len(reports) > 1)
        assert reports[-1].status[0].name == "servoloop: control loop"


@pytest.mark.slow
def test_signal_ends_the_stack_cleanly(ros_domain: int, tmp_path: Path) -> None:
    arguments = ("--hardware", "mock", "--namespace", "other")  # The stack of the other tests is running.
    with running(tmp_path, *arguments, module="tests.ros.unknown_rclpy") as stack:
        assert stack.end(signal.SIGTERM) == 0
        assert "Traceback" not in stack.words
