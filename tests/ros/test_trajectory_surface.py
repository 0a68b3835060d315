"""The joint trajectory controller as another process sees it: every row of ros2-surface.md, section 1 (the numbers
below), and of the first table of ros2-golden.md. "Ours" marks where we differ from upstream on purpose.

Rows that cannot be seen from outside stand in tests/controller: 23 (sampling) and 42 (late cycles) in
test_joint_trajectory_controller.py.
"""

import math
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

import rclpy
from action_msgs.msg import GoalStatusArray
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_msgs.msg import String

from hal.description import parse_urdf
from nodes.goals import RESULT_TIMEOUT_S
from servoloop.files import CONTROLLERS, URDF
from tests.ros.stack_process import JOINTS, running
from tests.ros.trajectory_client import ARM, LATCHED, TrajectoryClient, goal_of, point, trajectory

pytestmark = pytest.mark.ros

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # action_msgs/msg/GoalStatus
NAN, INF = math.nan, math.inf
REACHED = "Goal successfully reached!"
DEACTIVATED = "Current goal cancelled during deactivate transition."
ZERO, V, A = (0.0,) * 6, (0.2,) * 6, (0.5,) * 6
LARGEST_STEP_RAD = 1.001 * max(j.velocity for j in parse_urdf(URDF.read_text()).joints.values()) * 0.05


@contextmanager
def client_of(folder: Path, *arguments: str) -> Iterator[TrajectoryClient]:
    with running(folder, "--hardware", "mock", *arguments):
        rclpy.init()
        client = TrajectoryClient()
        try:
            yield client
        finally:
            client.close()
            rclpy.try_shutdown()


def controllers_file(folder: Path, *said: str) -> str:
    """The arm's own, with more said of the arm's controller."""
    text = CONTROLLERS.read_text()
    text = text.replace("    allow_nonzero_velocity_at_trajectory_end: true\n", "")
    mark = "    state_interfaces: [position, velocity]\n"
    assert mark in text
    (folder / "controllers.yaml").write_text(text.replace(mark, mark + "".join(f"    {line}\n" for line in said)))
    return str(folder / "controllers.yaml")


def mock_urdf(folder: Path, **parameters: str) -> str:
    """The arm on GenericSystem with no robot file, as a user of upstream has it; joint6 turns without end."""
    robot = ElementTree.parse(URDF)
    hardware = robot.find("ros2_control/hardware")
    assert hardware is not None
    hardware.clear()
    ElementTree.SubElement(hardware, "plugin").text = "mock_components/GenericSystem"
    for name, value in {"calculate_dynamics": "true", **parameters}.items():
        ElementTree.SubElement(hardware, "param", name=name).text = value
    joint = next(j for j in robot.findall("joint") if j.get("name") == "joint6")
    joint.set("type", "continuous")
    robot.write(folder / "arm.urdf")
    return str(folder / "arm.urdf")


def bent(message: Any, **fields: Any) -> Any:
    """The trajectory with other fields in its first point."""
    for name, value in fields.items():
        setattr(message.points[0], name, list(value))
    return message


@pytest.fixture(scope="class")
def ours(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    with client_of(tmp_path_factory.mktemp("ours")) as client:
        yield client


@pytest.fixture(scope="class")
def plain(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    folder = tmp_path_factory.mktemp("plain")
    said = (
        "allow_partial_joints_goal: true",
        "allow_integration_in_goal_trajectories: true",
        "constraints: {decelerate_on_cancel: false}",
        "action_monitor_rate: 5.0",
    )
    with client_of(folder, "--urdf", mock_urdf(folder), "--controllers", controllers_file(folder, *said)) as client:
        yield client


@pytest.fixture(scope="class")
def stuck(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    folder = tmp_path_factory.mktemp("stuck")
    said = controllers_file(folder, "interpolation_method: none")
    urdf = mock_urdf(folder, disable_commands="true")
    with client_of(folder, "--urdf", urdf, "--controllers", said) as client:
        yield client


T = trajectory
P = point
SUCCEEDING: dict[str, Callable[[TrajectoryClient], Any]] = {
    "13 one point": lambda c: goal_of(T(P(0.1, 0.4))),
    "two points": lambda c: goal_of(T(P(0.0, 0.3), P(0.1, 0.5))),
    "20 velocities": lambda c: goal_of(T(P(0.0, 0.3, V), P(0.1, 0.6, ZERO))),
    "20 velocities and accelerations": lambda c: goal_of(T(P(0.0, 0.3, V, A), P(0.1, 0.6, ZERO, ZERO))),
    "18 first point at 0": lambda c: goal_of(T(P(0.05, 0.0), P(0.1, 0.4))),
    "17 zero time (ours: no leap)": lambda c: goal_of(T(P(0.0, 0.0))),
    "10 ms (ours: no leap)": lambda c: goal_of(T(P(0.1, 0.01))),
    "negative time (ours: no leap)": lambda c: goal_of(T(P(0.0, -1.0))),
    "first of two negative": lambda c: goal_of(T(P(0.05, -0.5), P(0.1, 0.4))),
    "21 acceleration without velocity (ours: as if not said)": lambda c: goal_of(T(P(0.0, 0.4, (), A))),
    "5 permuted names": lambda c: goal_of(T(P((0.6, 0.5, 0.4, 0.3, 0.2, 0.1), 0.6), names=JOINTS[::-1])),
    "12 last velocity, parameter true": lambda c: goal_of(T(P(0.1, 0.4, V))),
    "15 stamp in the past, end ahead": lambda c: goal_of(T(P(0.0, 1.4), stamp=c.stamp(-1.0))),
    "16 stamp in the future": lambda c: goal_of(T(P(0.1, 0.2), stamp=c.stamp(0.3))),
    "30 tolerance of an unknown joint": lambda c: goal_of(T(P(0.0, 0.3)), path=("foo", 0.1)),
    "30 tolerance -1": lambda c: goal_of(T(P(0.1, 0.3)), goal=("joint1", -1.0)),
    "30 tolerance -2": lambda c: goal_of(T(P(0.0, 0.3)), goal=("joint1", -2.0)),
    "30 goal_time -2": lambda c: goal_of(T(P(0.1, 0.3)), goal_time_s=-2.0),
}
MISMATCH = "Joints on incoming trajectory don't match the controller joints."
FINITE = "only finite numbers are executed"
REFUSED: dict[str, tuple[Any, str]] = {
    "4 empty names": (T(P(0.1, 1.0), names=()), MISMATCH),
    "2 partial": (T(P((0.1,), 1.0), names=JOINTS[:1]), MISMATCH),
    "2 seven names": (T(P((0.1,) * 7, 1.0), names=(*JOINTS, "joint7")), MISMATCH),
    "4 unknown name": (
        T(P(0.1, 1.0), names=(*JOINTS[:5], "foo")),
        "Incoming joint foo doesn't match the controller's joints.",
    ),
    "6 duplicate name (ours)": (T(P(0.1, 1.0), names=(*JOINTS[:5], "joint1")), "Joint joint1 is named twice"),
    "7 no points": (T(), "Empty trajectory received."),
    "8 positions too short": (
        T(P((0.1,) * 5, 1.0)),
        "Mismatch between joint_names size (6) and positions (5) at point #0.",
    ),
    "8 positions too long": (T(P((0.1,) * 7, 1.0)), "names size (6) and positions (7) at point #0."),
    "8 velocities": (T(P(0.1, 1.0, (0.0,))), "names size (6) and velocities (1) at point #0."),
    "8 accelerations": (T(P(0.1, 1.0, ZERO, (0.0,))), "names size (6) and accelerations (1) at point #0."),
    "9 velocity only": (T(P((), 1.0, ZERO)), "names size (6) and positions (0) at point #0."),
    "10 effort": (
        T(P(0.1, 1.0, effort=ZERO)),
        "Trajectories with effort fields are only supported for controllers using the 'effort' command interface.",
    ),
    "11 equal times": (T(P(0.1, 1.0), P(0.2, 1.0)), "is not strictly increasing, it is 1.000000 and 1.000000 resp"),
    "11 decreasing times": (
        T(P(0.1, 1.0), P(0.2, 0.5)),
        "Time between points 0 and 1 is not strictly increasing, it is 1.000000 and 0.500000 respectively",
    ),
    "14 the end has passed": (
        T(P(0.1, 1.0), stamp=Time(sec=1000)),
        "Received trajectory with non-zero start time that ends in the past (",
    ),
    "41 NaN position (ours)": (T(P(NAN, 1.0)), FINITE),
    "41 inf position (ours)": (T(P(INF, 1.0)), FINITE),
    "41 NaN velocity (ours)": (T(P(0.1, 1.0, (NAN,) * 6), P(0.1, 2.0)), FINITE),
    "41 NaN in a middle point (ours)": (T(P(0.1, 1.0), P(NAN, 2.0), P(0.1, 3.0)), FINITE),
    "beyond a position limit (ours)": (T(P(2.5, 9.0)), "joint2 would go to 2.5000 at point #0, outside its limits"),
    "beyond a velocity limit (ours)": (T(P(0.1, 1.0, (5.0,) * 6), P(0.1, 2.0)), "joint1 would move at 5.0000"),
}


class TestOurConfiguration:
    """The stack as it comes, on the mock: ruckig."""

    @pytest.mark.parametrize("build", SUCCEEDING.values(), ids=SUCCEEDING.keys())
    def test_succeeds(self, ours: TrajectoryClient, build: Callable[[TrajectoryClient], Any]) -> None:
        goal, before = build(ours), len(ours.states)
        status, code, text = ours.outcome(ours.send(goal))
        assert (status, code) == (SUCCEEDED, 0)
        assert text.startswith(REACHED)
        end = ours.cycles(1)[-1]
        path = [state.output.positions for state in ours.states[before - 1 :]]
        steps = [abs(b - a) for one, other in pairwise(path) for a, b in zip(one, other, strict=True)]
        assert max(steps) <= LARGEST_STEP_RAD
        wanted = dict(zip(goal.trajectory.joint_names, goal.trajectory.points[-1].positions, strict=True))
        assert list(end.output.positions) == pytest.approx([wanted[name] for name in end.joint_names], abs=1e-6)

    @pytest.mark.parametrize(("message", "text"), REFUSED.values(), ids=REFUSED.keys())
    def test_refused_with_a_reason_on_the_status_topic(self, ours: TrajectoryClient, message: Any, text: str) -> None:
        assert text in ours.refusal(goal_of(message))

    def test_any_publisher_is_heard_and_any_listener_served(self, ours: TrajectoryClient) -> None:
        for name in ("joint_trajectory", "speed_scaling_input"):
            (listener,) = ours.node.get_subscriptions_info_by_topic(f"{ARM}/{name}")
            assert listener.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
        (publisher,) = ours.node.get_publishers_info_by_topic(f"{ARM}/controller_state")
        assert publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
        assert publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL

    def test_a_late_listener_learns_the_last_reason(self, ours: TrajectoryClient) -> None:
        ours.refusal(goal_of(T()))
        heard: list[str] = []
        late = ours.node.create_subscription(
            String, f"{ARM}/rejection_reason", lambda message: heard.append(message.data), LATCHED
        )
        ours.until(lambda: bool(heard))
        ours.node.destroy_subscription(late)
        assert heard == ["goal rejected: Empty trajectory received."]

    def test_12_a_last_velocity_is_refused_when_the_parameter_is_set_to_false(self, ours: TrajectoryClient) -> None:
        name = "allow_nonzero_velocity_at_trajectory_end"
        assert ours.set(name, False) == (True, "")
        try:
            reason = ours.refusal(goal_of(T(P(0.1, 1.0, V))))
        finally:
            assert ours.set(name, True) == (True, "")
        assert reason.endswith("Velocity of last trajectory point of joint joint1 is not zero: 0.200000000000000")

    def test_a_read_only_parameter(self, ours: TrajectoryClient) -> None:
        text = "parameter 'interpolation_method' cannot be set because it is read-only"
        assert ours.set("interpolation_method", "splines") == (False, text)

    def test_31_a_second_goal_ends_the_first(self, ours: TrajectoryClient) -> None:
        first = ours.send(goal_of(T(P(0.8, 3.0))))
        ours.cycles(4)
        second = ours.send(goal_of(T(P(0.0, 0.6))))
        text = "Current goal preempted by new incoming action."
        assert ours.outcome(first) == (ABORTED, -1, text)
        assert ours.outcome(second)[:2] == (SUCCEEDED, 0)

    def test_two_goals_in_the_same_instant(self, ours: TrajectoryClient) -> None:
        first, second = ours.send_two(goal_of(T(P(0.8, 3.0))), goal_of(T(P(0.1, 0.4))))
        assert ours.outcome(first)[:2] == (ABORTED, -1)
        assert ours.outcome(second)[:2] == (SUCCEEDED, 0)

    def test_a_second_goal_that_is_refused_leaves_the_first_alone(self, ours: TrajectoryClient) -> None:
        first = ours.send(goal_of(T(P(0.0, 0.6))))
        ours.refusal(goal_of(T(P(NAN, 1.0))))
        assert ours.outcome(first)[:2] == (SUCCEEDED, 0)

    def test_33_34_a_cancel_comes_to_rest_without_stepping_back(self, ours: TrajectoryClient) -> None:
        """Ours: it decelerates unless it is told not to."""
        sent = ours.send(goal_of(T(P(1.0, 1.5))))
        ours.until(lambda: ours.states[-1].reference.velocities[0] > 0.4)
        before = len(ours.states)
        assert ours.cancel(sent) == 1
        assert ours.outcome(sent) == (CANCELED, 0, "")
        ours.until(lambda: ours.states[-1].reference.velocities[0] == 0.0)
        seen = [state.output.positions[0] for state in ours.states[before:]]
        assert seen[0] > 0.0 and seen == sorted(seen)

    def test_32_topic_a_trajectory_is_executed_and_what_is_empty_or_partial_is_ignored(
        self, ours: TrajectoryClient
    ) -> None:
        ours.publish(T(P(0.3, 0.4)))
        ours.until(lambda: abs(ours.states[-1].output.positions[0] - 0.3) < 1e-6)
        sent = ours.send(goal_of(T(P(0.0, 0.8))))
        for message, text in ((T(), "Empty trajectory"), (T(P((0.1,), 1.0), names=JOINTS[:1]), MISMATCH)):
            before = len(ours.reasons)
            ours.publish(message)
            ours.until(lambda before=before: len(ours.reasons) > before)
            assert ours.reasons[-1].startswith("trajectory on the topic ignored: ") and text in ours.reasons[-1]
        assert ours.outcome(sent)[:2] == (SUCCEEDED, 0)

    def test_32_topic_a_trajectory_over_a_goal_ends_it_in_words(self, ours: TrajectoryClient) -> None:
        """Ours: upstream lets the goal succeed with a trajectory that its client never sent."""
        sent = ours.send(goal_of(T(P(0.8, 3.0))))
        ours.publish(T(P(0.0, 0.5)))
        text = "Current goal preempted by a trajectory on the topic joint_trajectory."
        assert ours.outcome(sent) == (ABORTED, -1, text)

    def test_37_feedback_has_upstreams_shape(self, ours: TrajectoryClient) -> None:
        sent = ours.send(goal_of(T(P(0.4, 0.6))))
        ours.outcome(sent)
        message = sent.feedback[-1]
        assert message.joint_names == list(JOINTS)
        assert message.header.frame_id == ""
        assert len(message.desired.positions) == len(message.desired.accelerations) == 6
        assert len(message.actual.positions) == len(message.actual.velocities) == 6
        assert len(message.actual.accelerations) == 0
        difference = [d - a for d, a in zip(message.desired.positions, message.actual.positions, strict=True)]
        assert list(message.error.positions) == pytest.approx(difference)

    def test_38_controller_state_comes_every_cycle_with_the_command_as_output(self, ours: TrajectoryClient) -> None:
        sent = ours.send(goal_of(T(P(0.0, 0.6))))
        states = ours.cycles(8)
        ours.outcome(sent)
        for before, after in pairwise(states):
            # The mock is where it was told to be: what is measured now is what was put out last.
            assert list(after.feedback.positions) == pytest.approx(list(before.output.positions))
        assert {state.speed_scaling_factor for state in states} == {1.0}

    def test_39_query_state(self, ours: TrajectoryClient) -> None:
        holding = ours.query(ours.stamp(0.0))
        assert (holding.success, list(holding.name)) == (False, list(JOINTS)) and len(holding.position) == 6
        sent = ours.send(goal_of(T(P(0.8, 2.0))))
        ours.until(lambda: ours.states[-1].reference.velocities[0] > 0.1)
        answers = [ours.query(ours.stamp(later_s)) for later_s in (-9.0, 0.05, 9.0)]
        assert [answer.success for answer in answers] == [False, True, False]
        assert 0.0 < answers[1].position[0] < 0.8
        assert answers[2].position[0] == pytest.approx(0.8)
        ours.cancel(sent)
        ours.outcome(sent)

    def test_43_speed_scaling(self, ours: TrajectoryClient) -> None:
        def factor() -> float:
            return float(ours.states[-1].speed_scaling_factor)

        ours.scale(0.5)
        ours.until(lambda: factor() == 0.5)
        ours.scale(-1.0)  # ignored
        first = ours.stamp(0.0)
        assert ours.outcome(ours.send(goal_of(T(P(0.0, 0.5)))))[:2] == (SUCCEEDED, 0)
        last = ours.stamp(0.0)
        assert (last.sec - first.sec) + (last.nanosec - first.nanosec) * 1e-9 >= 1.0
        assert factor() == 0.5
        ours.scale(0.0)
        ours.until(lambda: factor() == 0.0)
        sent = ours.send(goal_of(T(P(0.2, 0.3))))
        frozen = ours.cycles(10)[-1]
        assert frozen.output.positions[0] == pytest.approx(0.0, abs=1e-6)
        assert not sent.result.done()
        ours.scale(1.0)
        assert ours.outcome(sent)[:2] == (SUCCEEDED, 0)

    def test_40_cmd_timeout_can_be_set_and_nonsense_cannot(self, ours: TrajectoryClient) -> None:
        assert ours.set("cmd_timeout", 0.2) == (True, "")
        assert ours.outcome(ours.send(goal_of(T(P(0.1, 0.3)))))[:2] == (SUCCEEDED, 0)
        ours.cycles(8)
        assert ours.states[-1].output.positions[0] == pytest.approx(0.1, abs=1e-6)
        assert not ours.set("cmd_timeout", -1.0)[0]
        assert ours.set("cmd_timeout", 0.0) == (True, "")

    def test_1_35_36_inactive(self, ours: TrajectoryClient) -> None:
        sent = ours.send(goal_of(T(P(0.8, 3.0))))
        ours.until(lambda: ours.states[-1].reference.velocities[0] > 0.1)
        assert ours.switch(on=False)
        assert ours.outcome(sent) == (ABORTED, -1, DEACTIVATED)
        text = "Can't accept new action goals. Controller is not running."
        assert ours.refusal(goal_of(T(P(0.1, 1.0)))).endswith(text)
        answer = ours.query(ours.stamp(0.0))
        assert (answer.success, list(answer.name)) == (False, [])
        before, reasons = len(ours.states), len(ours.reasons)
        ours.publish(T(P(0.1, 1.0)))
        ours.until(lambda: len(ours.reasons) > reasons)
        assert len(ours.states) == before  # no controller_state while inactive
        held = ours.states[-1].output.positions[0]
        assert ours.switch(on=True)
        ours.cycles(3)
        assert ours.states[-1].reference.velocities[0] == 0.0
        assert ours.states[-1].output.positions[0] == pytest.approx(held, abs=0.1)
        assert ours.outcome(ours.send(goal_of(T(P(0.0, 0.6)))))[:2] == (SUCCEEDED, 0)

    def test_ended_goals_are_forgotten_as_upstream_does(self, ours: TrajectoryClient) -> None:
        """rclpy would name every goal of a quarter of an hour in every status message."""
        statuses: list[GoalStatusArray] = []
        topic = "/arm_controller/follow_joint_trajectory/_action/status"
        subscription = ours.node.create_subscription(GoalStatusArray, topic, statuses.append, LATCHED)
        for _ in range(2):
            ours.outcome(ours.send(goal_of(T(P(0.0, 0.3)))))
        assert len(statuses[-1].status_list) > 1
        forgotten_s = time.monotonic() + RESULT_TIMEOUT_S + 1.0
        ours.until(lambda: time.monotonic() > forgotten_s)
        ours.outcome(ours.send(goal_of(T(P(0.0, 0.3)))))
        ours.node.destroy_subscription(subscription)
        assert len(statuses[-1].status_list) == 1


class TestPlainFiles:
    """No robot file, a file for upstream: splines."""

    def test_19_positions_only_are_joined_by_straight_lines(self, plain: TrajectoryClient) -> None:
        before = len(plain.states)
        assert plain.outcome(plain.send(goal_of(T(P(0.0, 0.2), P(1.0, 1.0))))) == (SUCCEEDED, 0, REACHED)
        moving = [s for s in plain.states[before:] if 0.1 < s.reference.positions[0] < 0.9]
        assert moving
        for state in moving:
            assert list(state.reference.velocities) == pytest.approx([1.25] * 6, rel=1e-6)
            assert list(state.reference.accelerations) == pytest.approx(ZERO)

    def test_20_velocities_make_it_a_cubic(self, plain: TrajectoryClient) -> None:
        before = len(plain.states)
        assert plain.outcome(plain.send(goal_of(T(P(0.0, 1.0, ZERO))))) == (SUCCEEDED, 0, REACHED)
        fastest = max(abs(state.reference.velocities[0]) for state in plain.states[before:])
        assert 1.3 < fastest <= 1.5 + 1e-9  # half as fast again in the middle
        assert any(abs(state.reference.accelerations[0]) > 1.0 for state in plain.states[before:])

    def test_3_partial_goals_are_executed_and_the_others_hold(self, plain: TrajectoryClient) -> None:
        held = list(plain.states[-1].output.positions)
        sent = plain.send(goal_of(T(P((0.3,), 0.4), names=["joint3"])))
        assert plain.outcome(sent) == (SUCCEEDED, 0, REACHED)
        plain.cycles(2)
        held[2] = 0.3
        assert list(plain.states[-1].output.positions) == pytest.approx(held, abs=1e-9)
        assert plain.refusal(goal_of(T(P((), 1.0), names=()))).endswith("Empty joint names on incoming trajectory.")

    def test_9_velocities_alone_are_integrated(self, plain: TrajectoryClient) -> None:
        begin = plain.cycles(2)[-1].output.positions[0]
        sent = plain.send(goal_of(T(P((), 0.3, V), P((), 0.6, ZERO))))
        assert plain.outcome(sent) == (SUCCEEDED, 0, REACHED)
        plain.cycles(2)
        assert plain.states[-1].output.positions[0] == pytest.approx(begin + 0.06, abs=1e-6)

    def test_24_a_continuous_joint_goes_the_shorter_way(self, plain: TrajectoryClient) -> None:
        assert plain.outcome(plain.send(goal_of(T(P((*ZERO[:5], 3.0), 1.5))))) == (SUCCEEDED, 0, REACHED)
        assert plain.outcome(plain.send(goal_of(T(P((*ZERO[:5], -3.0), 0.5))))) == (SUCCEEDED, 0, REACHED)
        plain.cycles(2)
        assert plain.states[-1].output.positions[5] == pytest.approx(math.tau - 3.0, abs=1e-6)

    def test_12_a_last_velocity_is_refused_by_default(self, plain: TrajectoryClient) -> None:
        text = "Velocity of last trajectory point of joint joint1 is not zero: 0.200000000000000"
        assert plain.refusal(goal_of(T(P(0.1, 1.0, V)))).endswith(text)

    def test_33_a_cancel_holds_the_measured_position_where_told_to(self, plain: TrajectoryClient) -> None:
        sent = plain.send(goal_of(T(P(1.0, 3.0))))
        plain.cycles(8)
        plain.cancel(sent)
        assert plain.outcome(sent) == (CANCELED, 0, "")
        held = plain.cycles(2)[-1]
        assert list(held.output.positions) == pytest.approx(list(held.feedback.positions), abs=1e-9)

    def test_37_feedback_comes_at_the_monitor_rate(self, plain: TrajectoryClient) -> None:
        sent = plain.send(goal_of(T(P(0.0, 1.2))))
        plain.outcome(sent)
        stamps = [f.header.stamp.sec + f.header.stamp.nanosec * 1e-9 for f in sent.feedback]
        assert len(stamps) >= 3
        assert len(stamps) - 1 <= (stamps[-1] - stamps[0]) * 5.0 + 1.0  # every cycle would be 20 a second


class TestStuckJoints:
    """A mock that does not follow, and no interpolation."""

    def test_22_none_waits_for_the_first_points_time_and_then_goes_for_the_next(self, stuck: TrajectoryClient) -> None:
        before = len(stuck.states)
        sent = stuck.send(goal_of(T(P(0.1, 0.3), P(0.2, 0.6), P(0.3, 0.9))))
        assert stuck.outcome(sent) == (SUCCEEDED, 0, REACHED)
        seen = [round(s.reference.positions[0], 6) for s in stuck.states[before:]]
        assert sorted(set(seen)) == [0.0, 0.2, 0.3] and seen == sorted(seen)

    def test_26_without_tolerances_it_succeeds(self, stuck: TrajectoryClient) -> None:
        assert stuck.outcome(stuck.send(goal_of(T(P(0.5, 0.3))))) == (SUCCEEDED, 0, REACHED)

    def test_25_path_tolerance(self, stuck: TrajectoryClient) -> None:
        sent = stuck.send(goal_of(T(P(0.5, 0.2), P(0.6, 0.9)), path=("joint1", 0.05)))
        assert stuck.outcome(sent) == (ABORTED, -4, "Aborted due to path tolerance violation")

    def test_28_goal_time(self, stuck: TrajectoryClient) -> None:
        sent = stuck.send(goal_of(T(P(0.5, 0.2)), goal_time_s=0.5, goal=("joint1", 0.01)))
        status, code, text = stuck.outcome(sent)
        assert (status, code) == (ABORTED, -5)
        assert text.startswith("Aborted due to goal_time_tolerance exceeding by 0.5") and text.endswith(" seconds")

    def test_27_29_without_goal_time_it_goes_on_until_it_is_cancelled(self, stuck: TrajectoryClient) -> None:
        sent = stuck.send(goal_of(T(P(0.5, 0.2)), goal=("joint1", 0.01)))
        stuck.cycles(20)
        assert not sent.result.done()
        assert stuck.cancel(sent) == 1
        assert stuck.outcome(sent) == (CANCELED, 0, "")

    def test_40_cmd_timeout_ends_it_and_holds_what_is_measured(self, stuck: TrajectoryClient) -> None:
        assert stuck.set("cmd_timeout", 0.3) == (True, "")
        sent = stuck.send(goal_of(T(P(0.5, 0.2)), goal=("joint1", 0.01)))
        assert stuck.outcome(sent) == (ABORTED, -5, "Aborted due to command timeout")
        stuck.until(lambda: abs(stuck.states[-1].output.positions[0]) < 1e-9)
