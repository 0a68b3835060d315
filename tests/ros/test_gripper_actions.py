"""A gripper with both gripper actions of ros2_control, as seen from another process."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand, ParallelGripperCommand
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import JointState

from tests.ros.stack_process import PATIENCE_S, StackProcess, running, until

HAND = "hand_right_joint"
CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    gripper_controller: {{type: {kind}}}
gripper_controller:
  ros__parameters: {{joint: hand_right_joint, goal_tolerance: 0.0005}}
"""


class Gripper:
    """A client of the gripper action."""

    action: Any

    def __init__(self) -> None:
        self.node = Node("gripper_client")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.feedback: list[Any] = []
        self._client = ActionClient(self.node, self.action, "/gripper_controller/gripper_cmd")
        assert self._client.wait_for_server(PATIENCE_S)

    def close(self) -> None:
        self._client.destroy()  # ``destroy_node`` leaves action clients behind.
        self.node.destroy_node()

    @abstractmethod
    def goal(self, position: float, **fields: Any) -> Any:
        """Create a goal of the action."""

    def offer(self, goal: Any) -> Any:
        """Send a goal and return its handle, whether or not the goal is accepted."""
        self.feedback.clear()
        sending = self._client.send_goal_async(goal, feedback_callback=lambda m: self.feedback.append(m.feedback))
        return self.wait(sending)

    def send_all(self, *positions: float) -> list[Future]:
        """Send goals one after another, without a wait for the first, and return the futures of their results."""
        handles = [self.wait(sent) for sent in [self._client.send_goal_async(self.goal(one)) for one in positions]]
        assert all(handle.accepted for handle in handles)
        return [handle.get_result_async() for handle in handles]

    def send(self, position: float, **fields: Any) -> tuple[Any, Future]:
        """Send a goal that must be accepted, and return the future of its result."""
        handle = self.offer(self.goal(position, **fields))
        assert handle.accepted
        return handle, handle.get_result_async()

    def wait(self, future: Future) -> Any:
        self.spin_until(future.done)
        return future.result()

    def spin_until(self, ready: Callable[[], bool]) -> None:
        until(lambda: self._executor.spin_once(timeout_sec=0.1) or ready())

    def hand_at(self, position: float) -> None:
        """Wait until the fingers have reached a position."""
        seen: list[JointState] = []
        subscription = self.node.create_subscription(JointState, "/joint_states", seen.append, 10)
        self.spin_until(
            lambda: bool(seen) and abs(seen[-1].position[seen[-1].name.index(HAND)] - position) < 1e-6,
        )
        self.node.destroy_subscription(subscription)


class Parallel(Gripper):
    action = ParallelGripperCommand

    def goal(self, position: float, **fields: Any) -> Any:
        return ParallelGripperCommand.Goal(command=JointState(position=[position], **fields))


class Position(Gripper):
    action = GripperCommand

    def goal(self, position: float, **fields: Any) -> Any:
        goal = GripperCommand.Goal()
        goal.command.position = position
        goal.command.max_effort = fields.get("max_effort", 0.0)
        return goal


KINDS = {
    Parallel: "parallel_gripper_action_controller/GripperActionController",
    Position: "position_controllers/GripperActionController",
}


PARALLEL = pytest.mark.parametrize("kind", [Parallel], indirect=True, ids=["Parallel"])
"""Only this action has these fields."""


def _place(client: Gripper, message: Any) -> float:
    """Return the position in a result or feedback."""
    return float(message.state.position[0] if isinstance(client, Parallel) else message.position)


@pytest.fixture(scope="module", params=list(KINDS), ids=lambda kind: kind.__name__)
def kind(request: pytest.FixtureRequest) -> type[Gripper]:
    kind: type[Gripper] = request.param
    return kind


@pytest.fixture(scope="module")
def stack(kind: type[Gripper], ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("gripper")
    controllers = folder / "controllers.yaml"
    controllers.write_text(CONTROLLERS.format(kind=KINDS[kind]))
    with running(folder, "--hardware", "mock", "--controllers", str(controllers)) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(kind: type[Gripper], stack: StackProcess) -> Iterator[Gripper]:
    rclpy.init()
    client = kind()
    yield client
    client.close()
    rclpy.try_shutdown()


def test_gripper_opens_with_feedback_and_result(client: Gripper) -> None:
    _, future = client.send(0.05)
    answer = client.wait(future)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert (answer.result.reached_goal, answer.result.stalled) == (True, False)
    assert _place(client, answer.result) == pytest.approx(0.05, abs=0.0005)
    places = [_place(client, message) for message in client.feedback]
    assert places == sorted(places)
    assert any(0.0 < place < 0.05 for place in places)
    client.hand_at(0.05)


@pytest.mark.parametrize(
    ("position", "words"),
    [
        (0.06, "position 0.06 is outside the limits"),
        (-0.001, "position -0.001 is outside the limits"),
        (math.nan, f"the position of {HAND} must be finite, not nan"),
        (math.inf, f"the position of {HAND} must be finite, not inf"),
    ],
)
def test_position_outside_the_limits_is_rejected_with_its_value(
    client: Gripper, stack: StackProcess, position: float, words: str
) -> None:
    assert not client.offer(client.goal(position)).accepted
    until(lambda: f"goal rejected: {words}" in stack.words)


def test_new_goal_ends_the_old_goal(client: Gripper) -> None:
    old, new = map(client.wait, client.send_all(0.0, 0.05))
    assert old.status == GoalStatus.STATUS_ABORTED
    assert (old.result.reached_goal, old.result.stalled) == (False, False)
    assert new.status == GoalStatus.STATUS_SUCCEEDED
    client.hand_at(0.05)


def test_cancel_stops_the_fingers(client: Gripper) -> None:
    handle, future = client.send(0.0)
    client.spin_until(lambda: bool(client.feedback))
    assert len(client.wait(handle.cancel_goal_async()).goals_canceling) == 1
    answer = client.wait(future)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert 0.0 < _place(client, answer.result) <= 0.05
    assert len(client.wait(handle.cancel_goal_async()).goals_canceling) == 0


def test_effort_is_accepted_with_a_warning(client: Gripper, stack: StackProcess) -> None:
    fields = {"effort": [30.0]} if isinstance(client, Parallel) else {"max_effort": 30.0}
    _, future = client.send(0.02, **fields)
    assert client.wait(future).status == GoalStatus.STATUS_SUCCEEDED
    assert "max effort 30 is ignored: torque_limit in the robot file limits the force" in stack.words


def test_tolerances_can_be_set_at_run_time_but_not_the_joint(client: Gripper) -> None:
    setting = client.node.create_client(SetParameters, "/gripper_controller/set_parameters")
    assert setting.wait_for_service(PATIENCE_S)

    def refusal(**values: Any) -> str:
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        (answer,) = client.wait(setting.call_async(SetParameters.Request(parameters=parameters))).results
        return str(answer.reason)

    client.wait(client.send(0.02)[1])
    client.hand_at(0.02)
    assert "cannot be set because it is read-only" in refusal(joint="joint1")
    assert refusal(goal_tolerance=-1.0)
    assert refusal(goal_tolerance=0.02) == ""
    answer = client.wait(client.send(0.03)[1])
    # The fingers are within the tolerance from the first cycle on.
    assert _place(client, answer.result) == pytest.approx(0.02, abs=0.002)
    assert refusal(goal_tolerance=0.0005) == ""


@PARALLEL
@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"position": []}, "wrong number of position values, expects 1, got 0"),
        ({"position": [0.0, 0.0]}, "wrong number of position values, expects 1, got 2"),
        ({"position": [0.0], "name": ["joint1"]}, f"the goal is for joint1, but the joint of this gripper is {HAND}"),
        (
            {"position": [0.0], "velocity": [-1.0]},
            f"max velocity of {HAND} must be finite and at least 0, not -1.0",
        ),
        (
            {"position": [0.0], "velocity": [1.0, 1.0]},
            "2 values for velocity or effort: send at most one value for each",
        ),
    ],
)
def test_invalid_parallel_goal_is_rejected(
    client: Gripper, stack: StackProcess, fields: dict[str, Any], words: str
) -> None:
    assert not client.offer(ParallelGripperCommand.Goal(command=JointState(**fields))).accepted
    until(lambda: words in stack.words)


@PARALLEL
def test_parallel_goal_with_all_fields_returns_the_joint_state(client: Gripper) -> None:
    client.wait(client.send(0.05)[1])
    client.hand_at(0.05)
    _, future = client.send(0.03, name=[HAND], velocity=[0.02])
    answer = client.wait(future)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert list(answer.result.state.name) == [HAND]
    assert answer.result.state.header.stamp.sec > 0
    assert len(answer.result.state.velocity) == len(answer.result.state.effort) == 1
    assert {tuple(message.state.name) for message in client.feedback} == {(HAND,)}
