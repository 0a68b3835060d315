"""The replaced rclpy calls send and take the same data as rclpy, and other Python threads run meanwhile."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from action_msgs.msg import GoalStatusArray
from control_msgs.action import FollowJointTrajectory
from control_msgs.srv import QueryTrajectoryState
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from nodes.clients.client_node import client_node
from nodes.rclpy_patches.gil_release import replacements

PATIENCE_S = 30.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STATE = JointState(name=["a", "b"], position=[1.0, -2.5], velocity=[float("inf")], effort=[])
STATE.header.frame_id = "base_link"
REPORT = DiagnosticArray(
    status=[DiagnosticStatus(level=b"\x01", name="ä", values=[KeyValue(key="k", value="v" * 1000)])]
)
GOAL = FollowJointTrajectory.Goal(
    trajectory=JointTrajectory(
        joint_names=["a", "b"], points=[JointTrajectoryPoint(positions=[0.5, -0.5], velocities=[0.0, float("nan")])]
    )
)
ACCEPTED, CANCELED = 1, 5  # action_msgs/msg/GoalStatus

Session = tuple[Node, SingleThreadedExecutor]


@pytest.fixture
def session(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Session]:
    for owner, name, function in replacements():
        monkeypatch.setattr(owner, name, function)
    with client_node("test_gil_release") as session:
        yield session


def until(session: Session, ready: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not ready():
        assert time.monotonic() < deadline_s, "never came"
        session[1].spin_once(timeout_sec=0.1)


def wait(session: Session, future: Future) -> Any:
    until(session, future.done)
    return future.result()


@pytest.mark.parametrize("message", [STATE, REPORT, String(data=""), String(data="x" * 100_000)], ids=lambda m: "")
def test_message_arrives_complete(session: Session, message: Any) -> None:
    node = session[0]
    out = node.create_publisher(type(message), "/out", LATCHED)
    heard: list[Any] = []
    node.create_subscription(type(message), "/out", heard.append, LATCHED)
    out.publish(message)
    until(session, lambda: heard)
    assert heard == [message]


def test_message_of_another_type_is_refused(session: Session) -> None:
    with pytest.raises(TypeError, match=r"Expected .*String.*, got .*JointState"):
        session[0].create_publisher(String, "/out", 10).publish(STATE)


def test_invalid_message_raises_as_in_rclpy(session: Session) -> None:
    state = JointState()
    state._position = None
    with pytest.raises(TypeError, match="position"):
        session[0].create_publisher(JointState, "/out", 10).publish(state)


def test_service_receives_and_responds(session: Session) -> None:
    node, asked = session[0], []

    def answer(
        request: QueryTrajectoryState.Request, response: QueryTrajectoryState.Response
    ) -> QueryTrajectoryState.Response:
        asked.append(request)
        response.name, response.position = ["a", "b"], [0.5, float("-inf")]
        return response

    node.create_service(QueryTrajectoryState, "/query", answer)
    client = node.create_client(QueryTrajectoryState, "/query")
    assert client.wait_for_service(PATIENCE_S)
    request = QueryTrajectoryState.Request()
    request.time.sec = -7
    expected = QueryTrajectoryState.Response(name=["a", "b"], position=[0.5, float("-inf")])
    for _ in range(3):
        assert wait(session, client.call_async(request)) == expected
    assert asked == [request] * 3


def test_response_of_another_type_is_refused(session: Session) -> None:
    node = session[0]
    service = node.create_service(QueryTrajectoryState, "/query", lambda _request, _response: STATE)
    client = node.create_client(QueryTrajectoryState, "/query")
    assert client.wait_for_service(PATIENCE_S)
    client.call_async(QueryTrajectoryState.Request())
    with pytest.raises(TypeError, match=f"{service.srv_name} needs a QueryTrajectoryState"):
        until(session, lambda: False)


def test_action_is_served_from_goal_to_result(session: Session) -> None:
    node, decided, goals = session[0], Future(), []

    async def execute(goal: ServerGoalHandle) -> FollowJointTrajectory.Result:
        goals.append(goal)
        await decided
        goal.canceled()
        return FollowJointTrajectory.Result(error_code=-4, error_string="ä" * 100)

    server = ActionServer(
        node,
        FollowJointTrajectory,
        "/follow",
        execute,
        goal_callback=lambda g: GoalResponse.REJECT if not g.trajectory.points else GoalResponse.ACCEPT,
        cancel_callback=lambda _goal: CancelResponse.ACCEPT,
    )
    client = ActionClient(node, FollowJointTrajectory, "/follow")
    statuses: list[int] = []
    node.create_subscription(
        GoalStatusArray, "/follow/_action/status", lambda m: statuses.extend(s.status for s in m.status_list), 10
    )
    heard: list[Any] = []
    assert client.wait_for_server(PATIENCE_S)

    assert not wait(session, client.send_goal_async(FollowJointTrajectory.Goal())).accepted
    handle = wait(session, client.send_goal_async(GOAL, feedback_callback=lambda m: heard.append(m.feedback)))
    assert handle.accepted
    until(session, lambda: goals)
    assert str(goals[0].request) == str(GOAL)  # NaN is not equal to itself
    feedback = FollowJointTrajectory.Feedback(joint_names=["a", "b"])

    def fed() -> bool:
        goals[0].publish_feedback(feedback)
        session[1].spin_once(timeout_sec=0.1)
        return bool(heard)

    until(session, fed)
    assert heard[0] == feedback
    assert len(wait(session, handle.cancel_goal_async()).goals_canceling) == 1
    result = handle.get_result_async()
    decided.set_result(None)
    answer = wait(session, result)
    assert answer.status == CANCELED
    assert answer.result == FollowJointTrajectory.Result(error_code=-4, error_string="ä" * 100)
    until(session, lambda: CANCELED in statuses)
    assert statuses[0] == ACCEPTED
    server.destroy()


def test_middleware_failure_raises_an_error_of_rclpy(session: Session) -> None:
    out = session[0].create_publisher(String, "/out", 10)
    session[0].context.shutdown()
    with pytest.raises(rclpy_implementation.RCLError, match=r"could not publish: .*context"):
        out.publish(String())


def test_python_runs_during_a_response_to_an_incompatible_client(
    session: Session, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The QoS of the client is incompatible with the service, so the middleware waits 0.1 s for a reader."""
    node, done, ticks, meanwhile = session[0], threading.Event(), [0], []

    def tick() -> None:
        while not done.wait(0.001):
            ticks[0] += 1

    service = node.create_service(QueryTrajectoryState, "/query", lambda _request, response: response)
    send = type(service).send_response

    def counted(*arguments: Any) -> None:
        before = ticks[0]
        send(*arguments)
        meanwhile.append(ticks[0] - before)

    monkeypatch.setattr(type(service), "send_response", counted)
    client = node.create_client(QueryTrajectoryState, "/query", qos_profile=LATCHED)
    thread = threading.Thread(target=tick)
    thread.start()
    try:
        client.call_async(QueryTrajectoryState.Request())
        until(session, lambda: meanwhile)
    finally:
        done.set()
        thread.join()
    assert meanwhile[0] > 5  # With plain rclpy, this is 0 or 1.
    assert "/query: no response could be sent to a client: it has left, or its QoS is incompatible" in caplog.text
