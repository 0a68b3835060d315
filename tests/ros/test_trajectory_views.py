"""Feedback, states and queries of a running trajectory, as seen from another process."""

from collections.abc import Collection, Iterator
from itertools import pairwise

import pytest
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from sensor_msgs.msg import JointState

from tests.ros.deaf import deaf_client
from tests.ros.stack_process import JOINTS
from tests.ros.topic_client import EVERY
from tests.ros.trajectory_client import (
    ARM,
    ZERO,
    TrajectoryClient,
    goal_of,
    point,
    stamp_s,
    trajectory,
)
from tests.ros.trajectory_stacks import LARGEST_STEP_RAD, MOCK, PERIOD_S, client_of, largest_step_rad

T, P = trajectory, point


@pytest.fixture(scope="module")
def ours(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    with client_of(tmp_path_factory.mktemp("ours"), *MOCK) as client:
        yield client


def without_feedback(cycles_s: list[float], with_feedback_s: Collection[float]) -> list[float]:
    """Return the cycles for which no feedback was published.

    A cycle that follows shortly after a late cycle is excluded, because it may have no feedback of its own.
    """
    close = {after for before, after in pairwise(cycles_s) if after - before < 0.6 * PERIOD_S}
    return [cycle_s for cycle_s in cycles_s if cycle_s not in with_feedback_s and cycle_s not in close]


@pytest.mark.row("golden-qos")
def test_any_publisher_and_subscriber_is_served(ours: TrajectoryClient) -> None:
    for name in ("joint_trajectory", "speed_scaling_input"):
        (listener,) = ours.node.get_subscriptions_info_by_topic(f"{ARM}/{name}")
        assert listener.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    (publisher,) = ours.node.get_publishers_info_by_topic(f"{ARM}/controller_state")
    assert publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
    assert publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.row("jtc-37", "golden-feedback")
def test_feedback_has_the_ros2_control_form_and_comes_at_20_hz(ours: TrajectoryClient) -> None:
    before = ours.now()
    sent = ours.send(goal_of(T(P(-0.4, 0.8))))
    ours.outcome(sent)
    ours.cycles(1)
    for message in sent.feedback:
        assert message.joint_names == list(JOINTS)
        assert message.header.frame_id == ""
        assert len(message.desired.positions) == len(message.desired.accelerations) == 6
        assert len(message.actual.positions) == len(message.actual.velocities) == 6
        assert len(message.actual.accelerations) == 0
        difference = [d - a for d, a in zip(message.desired.positions, message.actual.positions, strict=True)]
        assert list(message.error.positions) == pytest.approx(difference, abs=1e-9)
    told = {stamp_s(message): message for message in sent.feedback}
    meanwhile = [state for state in ours.states[before:] if min(told) <= stamp_s(state) <= max(told)]
    assert len(meanwhile) > 8
    assert without_feedback([stamp_s(state) for state in meanwhile], told) == []
    for state in meanwhile:
        assert stamp_s(state) not in told or told[stamp_s(state)].desired == state.reference


@pytest.mark.row("jtc-38", "golden-state")
def test_controller_state_is_published_every_cycle_with_the_command(ours: TrajectoryClient) -> None:
    cycles: list[float] = []
    listener = ours.node.create_subscription(JointState, "/joint_states", lambda m: cycles.append(stamp_s(m)), 100)
    ours.until(lambda: bool(cycles))
    sent = ours.send(goal_of(T(P(0.4, 0.6))))
    states = ours.cycles(10)
    ours.outcome(sent)
    ours.cycles(2)
    ours.node.destroy_subscription(listener)
    stamps = [stamp_s(state) for state in ours.states]
    assert [cycle for cycle in cycles if cycle < stamps[-1] and cycle not in stamps] == []
    between = sorted(after - before for before, after in pairwise(map(stamp_s, states)))
    # Half of the messages are sufficient, because machines can be late.
    assert between[len(between) // 2] == pytest.approx(PERIOD_S, abs=0.01)
    for before, after in pairwise(states):
        assert list(after.joint_names) == list(JOINTS)
        # The mock is at its command, so the measured position equals the last output.
        assert list(after.feedback.positions) == pytest.approx(list(before.output.positions), abs=1e-9)
        difference = [r - f for r, f in zip(after.reference.positions, after.feedback.positions, strict=True)]
        assert list(after.error.positions) == pytest.approx(difference, abs=1e-9)
    assert any(state.reference.velocities[0] for state in states)
    assert {state.speed_scaling_factor for state in states} == {1.0}


@pytest.mark.row("jtc-38", "jtc-37")
def test_every_cycle_has_state_and_feedback_even_if_the_ros_thread_was_blocked(ours: TrajectoryClient) -> None:
    cycles: list[float] = []
    listener = ours.node.create_subscription(JointState, "/joint_states", lambda m: cycles.append(stamp_s(m)), EVERY)
    ours.until(lambda: bool(cycles))
    with deaf_client(ours.node) as hold_up:
        sent = ours.send(goal_of(T(P(0.0, 0.8), P(0.4, 2.0))))
        for _ in range(3):
            hold_up()
            ours.cycles(8)
    ours.outcome(sent)
    ours.cycles(2)
    ours.node.destroy_subscription(listener)
    stamps = [stamp_s(state) for state in ours.states]
    told = [stamp_s(message) for message in sent.feedback]
    assert [cycle for cycle in cycles if cycle < stamps[-1] and cycle not in stamps] == []
    assert without_feedback([cycle for cycle in cycles if told[0] < cycle < told[-1]], told) == []
    shown = {stamp_s(state): state for state in ours.states}
    for message in sent.feedback:
        assert message.desired == shown[stamp_s(message)].reference
    assert largest_step_rad(ours.states) <= LARGEST_STEP_RAD
    assert len(told) > 30


@pytest.mark.row("jtc-39", "golden-query")
def test_query_state_returns_the_trajectory(ours: TrajectoryClient) -> None:
    held = ours.cycles(1)[-1].reference.positions
    holding = ours.query(ours.stamp(0.0))
    assert (holding.success, list(holding.name)) == (False, list(JOINTS))
    assert list(holding.position) == pytest.approx(list(held), abs=1e-6)
    sent = ours.send(goal_of(T(P(-0.8, 2.0))))
    ours.until(lambda: abs(ours.states[-1].reference.velocities[0]) > 0.3)
    seen = ours.states[-1]
    in_mid_way = ours.query(seen.header.stamp)
    assert in_mid_way.success
    assert list(in_mid_way.position) == pytest.approx(list(seen.reference.positions), abs=5e-3)
    assert list(in_mid_way.velocity) == pytest.approx(list(seen.reference.velocities), abs=0.05)
    before, after = ours.query(ours.stamp(-9.0)), ours.query(ours.stamp(9.0))
    assert (before.success, after.success) == (False, False)
    assert list(before.position) == pytest.approx(list(held), abs=1e-6)
    assert list(after.position) == pytest.approx([-0.8] * 6, abs=1e-6) and list(after.velocity) == list(ZERO)
    ours.cancel(sent)
    ours.outcome(sent)
