"""Messages that are too large are rejected before they are read. Clients of services and actions still receive a
response."""

from collections.abc import Iterator
from typing import Any

import pytest
from control_msgs.action import FollowJointTrajectory
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from nodes.publishing import LATCHED
from tests.ros.manager_client import MANAGER, ManagerClient
from tests.ros.stack_process import JOINTS, PATIENCE_S, READY, StackProcess

ACTION = "/arm_controller/follow_joint_trajectory"
LIMIT = "max_message_size"
REASON = "it is larger than 2 MB. Send smaller messages, or raise max_message_size of /controller_manager"


def trajectory(points: int) -> JointTrajectory:
    """Create a trajectory to one pose that has points at minimal time intervals."""
    message = JointTrajectory(joint_names=list(JOINTS))
    for number in range(1, points + 1):
        point = JointTrajectoryPoint(positions=list(READY))
        point.time_from_start.sec, nanosec = divmod(number * 5_000_000 + 2_000_000_000, 1_000_000_000)
        point.time_from_start.nanosec = nanosec
        message.points.append(point)
    return message


@pytest.fixture(scope="module")
def action(connected: ManagerClient) -> Iterator[ActionClient]:
    client = ActionClient(connected.node, FollowJointTrajectory, ACTION)
    assert client.wait_for_server(PATIENCE_S)
    yield client
    client.destroy()


def accepted(client: ManagerClient, action: ActionClient, points: int) -> bool:
    goal = FollowJointTrajectory.Goal(trajectory=trajectory(points))
    (handle,) = client.wait(action.send_goal_async(goal))
    if handle.accepted:
        client.wait(handle.cancel_goal_async(), handle.get_result_async())
    return bool(handle.accepted)


def test_goal_with_too_many_points_is_rejected_and_the_next_is_served(
    client: ManagerClient, action: ActionClient, stack: StackProcess
) -> None:
    with client.hearing(String, "/arm_controller/rejection_reason", LATCHED) as reasons:
        assert not accepted(client, action, 50_000)
        client.spin_until(lambda: reasons)
    assert reasons[0].data == f"goal rejected: {REASON}"
    assert f"{ACTION}: a message was rejected before it was read: {REASON}" in stack.words
    assert accepted(client, action, 5)


@pytest.fixture
def small(client: ManagerClient) -> Iterator[None]:
    """Set the lowest limit, because large messages on a best-effort topic are often lost."""
    assert client.put(MANAGER, LIMIT, 10_000) == ""
    yield
    assert client.put(MANAGER, LIMIT, 2_000_000) == ""


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("/arm_controller/joint_trajectory", trajectory(100)),
        ("/hand_controller/commands", Float64MultiArray(data=[0.01] * 2_000)),
    ],
    ids=["trajectory", "command"],
)
def test_large_message_on_a_topic_is_dropped(
    client: ManagerClient, small: None, stack: StackProcess, topic: str, message: Any
) -> None:
    out = client.node.create_publisher(type(message), topic, 10)
    client.spin_until(out.get_subscription_count)
    out.publish(message)
    client.spin_until(lambda: f"{topic}: a message was rejected before it was read" in stack.words)
    client.node.destroy_publisher(out)


def test_large_request_has_an_empty_response(client: ManagerClient, stack: StackProcess) -> None:
    value = ParameterValue(type=4, string_value="x" * 3_000_000)
    service = f"{MANAGER}/set_parameters"
    answer = client.call(SetParameters, service, parameters=[Parameter(name="late.type", value=value)])
    assert list(answer.results) == []
    assert f"{service}: a message was rejected before it was read" in stack.words
    assert client.get(MANAGER, "late.type") == [None]


def test_limit_is_a_parameter_of_the_manager(client: ManagerClient, action: ActionClient) -> None:
    assert client.get(MANAGER, LIMIT) == [2_000_000]
    assert client.put(MANAGER, LIMIT, 5).startswith("max_message_size must be 10000 to 1e+09 bytes, not 5")
    assert accepted(client, action, 100)
    assert client.put(MANAGER, LIMIT, 10_000) == ""
    assert not accepted(client, action, 100)
    assert client.put(MANAGER, LIMIT, 2_000_000) == ""
