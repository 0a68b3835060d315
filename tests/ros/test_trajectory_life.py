"""Life cycle of a goal in the default stack, as seen from another process.

"In contrast" marks deliberate differences from ros2_control.
"""

import math
import time
from collections.abc import Iterator

import pytest
from action_msgs.msg import GoalStatusArray
from controller_manager_msgs.srv import CleanupController, ConfigureController
from sensor_msgs.msg import JointState

from nodes.controllers.action_goals import RESULT_TIMEOUT_S
from tests.ros.stack_process import JOINTS
from tests.ros.trajectory_client import (
    ABORTED,
    CANCELED,
    LATCHED,
    REACHED,
    SUCCEEDED,
    ZERO,
    TrajectoryClient,
    goal_of,
    point,
    trajectory,
)
from tests.ros.trajectory_stacks import LARGEST_STEP_RAD, MOCK, client_of, largest_step_rad, rises

T, P = trajectory, point
MANAGER, NAME = "/controller_manager", "arm_controller"
PREEMPTED = "Current goal preempted by new incoming action."
DEACTIVATED = "Current goal cancelled during deactivate transition."
NOT_RUNNING = "Can't accept new action goals. Controller is not running."


@pytest.fixture(scope="module")
def ours(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    with client_of(tmp_path_factory.mktemp("ours"), *MOCK) as client:
        yield client


def speed_rad_s(client: TrajectoryClient) -> float:
    return abs(float(client.states[-1].reference.velocities[0]))


@pytest.mark.slow
def test_ended_goals_are_removed_as_in_ros2_control(ours: TrajectoryClient) -> None:
    """rclpy would list every goal of the last 15 min in every status message.

    This must be the first test that uses the stack, and its second goal must take longer than the first. rcl removes
    old goals only at certain times, which depend on all earlier goals.
    """
    statuses: list[GoalStatusArray] = []
    topic = "/arm_controller/follow_joint_trajectory/_action/status"
    subscription = ours.node.create_subscription(GoalStatusArray, topic, statuses.append, LATCHED)
    for after_s in (0.3, 0.7):
        ours.outcome(ours.send(goal_of(T(P(0.0, after_s)))))
    assert len(statuses[-1].status_list) > 1
    forgotten_s = time.monotonic() + RESULT_TIMEOUT_S + 1.0
    ours.until(lambda: time.monotonic() > forgotten_s)
    ours.outcome(ours.send(goal_of(T(P(0.0, 0.3)))))
    ours.node.destroy_subscription(subscription)
    assert len(statuses[-1].status_list) == 1


@pytest.mark.row("jtc-31", "golden-second-goal", "moveit-status")
def test_second_goal_ends_the_first_immediately_and_is_executed(ours: TrajectoryClient) -> None:
    ours.executed(goal_of(T(P(0.0, 0.4))))
    before = ours.now()
    first = ours.send(goal_of(T(P(0.8, 3.0))))
    ours.until(lambda: speed_rad_s(ours) > 0.1)
    second = ours.send(goal_of(T(P(-0.2, 0.8))))
    assert ours.outcome(first) == (ABORTED, -1, PREEMPTED)
    assert ours.states[-1].reference.positions[0] > -0.1  # long before the second goal has ended
    assert ours.outcome(second) == (SUCCEEDED, 0, REACHED)
    ours.cycles(2)
    assert ours.states[-1].output.positions[0] == pytest.approx(-0.2, abs=1e-6)
    assert largest_step_rad(ours.states[before:]) <= LARGEST_STEP_RAD


@pytest.mark.row("golden-two-at-once", "jtc-31")
def test_second_of_two_simultaneous_goals_is_executed(ours: TrajectoryClient) -> None:
    first, second = ours.send_two(goal_of(T(P(0.8, 3.0))), goal_of(T(P(0.1, 0.6))))
    assert ours.outcome(first) == (ABORTED, -1, PREEMPTED)
    assert ours.outcome(second) == (SUCCEEDED, 0, REACHED)
    assert ours.cycles(2)[-1].output.positions[0] == pytest.approx(0.1, abs=1e-6)


@pytest.mark.row("golden-second-refused")
def test_rejected_second_goal_does_not_affect_the_first(ours: TrajectoryClient) -> None:
    ours.executed(goal_of(T(P(0.1, 0.4))))
    before = ours.now()
    first = ours.send(goal_of(T(P(0.0, 0.6))))
    ours.until(lambda: speed_rad_s(ours) > 0.05)
    ours.refusal(goal_of(T(P(math.nan, 1.0))))
    assert ours.outcome(first) == (SUCCEEDED, 0, REACHED)
    ours.cycles(2)
    path = [state.output.positions[0] for state in ours.states[before:]]
    assert rises(path[::-1]) and path[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.row("jtc-33", "jtc-34", "golden-cancel", "moveit-cancel", "moveit-status")
def test_cancel_is_answered_immediately_and_stops_without_a_step_back(ours: TrajectoryClient) -> None:
    """In contrast to ros2_control, the arm decelerates by default."""
    sent = ours.send(goal_of(T(P(2.0, 4.0))))
    ours.until(lambda: speed_rad_s(ours) > 0.4)
    before = len(ours.states)
    assert ours.cancel(sent) == 1
    assert ours.outcome(sent) == (CANCELED, 0, "")
    assert len(ours.states) - before <= 5
    ours.until(lambda: speed_rad_s(ours) == 0.0)
    ours.cycles(3)
    seen = [state.output.positions[0] for state in ours.states[before:]]
    assert 0.0 < seen[0] < seen[-1] < 1.5
    assert rises(seen) and seen[-1] == seen[-3]
    assert min(state.reference.accelerations[0] for state in ours.states[before:]) >= -12.0 - 1e-6


@pytest.mark.row("jtc-7", "jtc-32", "golden-topic")
def test_trajectory_on_the_topic_is_executed_unless_empty_or_partial(ours: TrajectoryClient) -> None:
    before = ours.now()
    ours.publish(T(P(0.3, 0.4)))
    ours.until(lambda: abs(ours.states[-1].output.positions[0] - 0.3) < 1e-6)
    assert largest_step_rad(ours.states[before:]) <= LARGEST_STEP_RAD
    sent, before = ours.send(goal_of(T(P(0.0, 0.8)))), len(ours.states)
    mismatch = (
        "Joints on incoming trajectory don't match the controller joints. The goal names 1 (joint1), but the "
        f"controller has 6 ({', '.join(JOINTS)}): name each joint of the controller."
    )
    for message, text in ((T(), "Empty trajectory received."), (T(P((0.1,), 1.0), names=JOINTS[:1]), mismatch)):
        said = len(ours.reasons)
        ours.publish(message)
        ours.until(lambda said=said: len(ours.reasons) > said)
        assert ours.reasons[-1] == f"trajectory on the topic ignored: {text}"
        assert ours.reasons[-1] in ours.stack.words
    assert ours.outcome(sent) == (SUCCEEDED, 0, REACHED)
    ours.cycles(2)
    path = [state.output.positions[0] for state in ours.states[before:]]
    assert rises(path[::-1]) and path[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.row("jtc-32", "golden-topic-over-goal", "trouble-reason")
def test_trajectory_on_the_topic_ends_a_goal_with_a_reason(ours: TrajectoryClient) -> None:
    """In contrast, ros2_control ends the goal as successful although the arm follows a trajectory that the goal's
    client never sent."""
    sent = ours.send(goal_of(T(P(0.8, 3.0))))
    ours.publish(T(P(0.2, 0.5)))
    text = "Current goal preempted by a trajectory on the topic joint_trajectory."
    assert ours.outcome(sent) == (ABORTED, -1, text)
    ours.until(lambda: speed_rad_s(ours) > 0.0)
    ours.until(lambda: speed_rad_s(ours) == 0.0)
    assert ours.states[-1].output.positions[0] == pytest.approx(0.2, abs=1e-6)


@pytest.mark.row("jtc-40")
def test_cmd_timeout_can_be_set_to_valid_values_only(ours: TrajectoryClient) -> None:
    assert ours.set("cmd_timeout", 0.2) == (True, "")
    ours.executed(goal_of(T(P(0.1, 0.5))))
    ours.cycles(8)
    assert ours.states[-1].output.positions[0] == pytest.approx(0.1, abs=1e-6)
    assert not ours.set("cmd_timeout", -1.0)[0]
    assert ours.set("cmd_timeout", 0.0) == (True, "")


@pytest.mark.row("jtc-35", "jtc-36", "golden-deactivate")
def test_controller_is_deactivated_during_a_goal_and_activated_again(ours: TrajectoryClient) -> None:
    sent = ours.send(goal_of(T(P(0.8, 3.0))))
    ours.until(lambda: speed_rad_s(ours) > 0.1)
    assert ours.switch(on=False)
    assert ours.outcome(sent) == (ABORTED, -1, DEACTIVATED)
    last = ours.states[-1]
    moving: list[float] = []
    listener = ours.node.create_subscription(JointState, "/joint_states", lambda m: moving.append(m.velocity[-1]), 10)
    ours.until(lambda: bool(moving) and moving[-1] == 0.0)
    ours.node.destroy_subscription(listener)
    before = len(ours.states)
    assert ours.switch(on=True)
    ours.until(lambda: len(ours.states) >= before + 4)
    begun = ours.states[before:]
    for state in begun:  # exactly at the last command, which is the position of this mock
        assert list(state.output.positions) == pytest.approx(list(begun[0].feedback.positions), abs=1e-9)
        assert list(state.reference.velocities) == list(ZERO)
    assert 0.0 <= begun[0].output.positions[0] - last.output.positions[0] < 0.2
    ours.executed(goal_of(T(P(0.0, 0.6))))


@pytest.mark.row("jtc-1", "golden-inactive", "golden-query")
def test_inactive_controller_rejects_goals_ignores_the_topic_and_publishes_nothing(ours: TrajectoryClient) -> None:
    """The action server exists as soon as the controller is configured."""
    assert ours.switch(on=False)
    assert ours.call(CleanupController, f"{MANAGER}/cleanup_controller", CleanupController.Request(name=NAME)).ok
    ours.until(lambda: not ours.action.server_is_ready())
    assert ours.call(ConfigureController, f"{MANAGER}/configure_controller", ConfigureController.Request(name=NAME)).ok
    ours.until(ours.action.server_is_ready)
    assert ours.refusal(goal_of(T(P(0.1, 1.0)))).endswith(NOT_RUNNING)
    answer = ours.query(ours.stamp(0.0))
    assert (answer.success, list(answer.name), list(answer.position)) == (False, [], [])
    before, reasons = len(ours.states), len(ours.reasons)
    ours.until(ours.topic_is_heard)
    ours.publish(T(P(0.1, 0.1)))
    ours.until(lambda: len(ours.reasons) > reasons)
    assert ours.reasons[-1].endswith(NOT_RUNNING)
    assert len(ours.states) == before
    assert ours.switch(on=True)
    assert ours.cycles(4)[-1].output.positions[0] == pytest.approx(0.0, abs=1e-6)
    ours.executed(goal_of(T(P(0.2, 0.4))))
