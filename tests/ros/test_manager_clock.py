"""The control cycle follows ``update_rate`` and stamps use the system clock, regardless of ROS time."""

import time
from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from controller_manager_msgs.msg import ControllerManagerActivity
from controller_manager_msgs.srv import ListHardwareComponents
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import TransitionEvent
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from servoloop.stack.shipped_files import CONTROLLERS
from tests.ros.manager_client import MANAGER, ManagerClient, manager_client
from tests.ros.stack_process import PICK, READY, StackProcess, running
from tests.ros.trajectory_client import TrajectoryClient, goal_of, point, trajectory

RATE_HZ = 50
NODES = (MANAGER, "/arm_controller", "/hand_controller", "/joint_state_broadcaster", "/robot_arm")
SIMULATED = Time(sec=1000)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SUCCEEDED = 4  # action_msgs/msg/GoalStatus


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    """Use an update rate that differs from the default file."""
    folder = tmp_path_factory.mktemp("clock")
    controllers = folder / "controllers.yaml"
    controllers.write_text(CONTROLLERS.read_text().replace("update_rate: 20\n", f"update_rate: {RATE_HZ}\n"))
    with running(folder, "--hardware", "mock", "--controllers", str(controllers)) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[ManagerClient]:
    with manager_client() as client:
        yield client


@pytest.fixture
def sim_time(client: ManagerClient) -> Iterator[Any]:
    """Switch all nodes to a clock that stands still, and provide the publisher of that clock."""
    clock = client.node.create_publisher(Clock, "/clock", LATCHED)
    for node in NODES:
        assert client.put(node, "use_sim_time", True) == ""
    client.spin_until(lambda: clock.get_subscription_count() >= len(NODES))
    clock.publish(Clock(clock=SIMULATED))
    yield clock
    for node in NODES:
        assert client.put(node, "use_sim_time", False) == ""
    client.node.destroy_publisher(clock)


def seconds(stamp: Time) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9)


def periods_s(messages: Sequence[JointState]) -> list[float]:
    stamps_s = [seconds(message.header.stamp) for message in messages]
    return [after - before for before, after in pairwise(stamps_s)]


def joint_states(client: ManagerClient, count: int) -> list[JointState]:
    with client.hearing(JointState, "/joint_states") as received:
        client.spin_until(lambda: len(received) >= count)
    return received


@pytest.mark.row("cm-update-rate")
def test_every_cycle_takes_one_period_of_the_update_rate(client: ManagerClient) -> None:
    # The median is used, because a busy machine has late cycles from time to time.
    assert median(periods_s(joint_states(client, 60))) == pytest.approx(1.0 / RATE_HZ, rel=0.1)


@pytest.mark.row("cm-update-rate")
def test_all_interfaces_report_the_rate(client: ManagerClient) -> None:
    assert client.get(MANAGER, "update_rate") == [RATE_HZ]
    assert {controller.update_rate for controller in client.listed().values()} == {RATE_HZ}
    (component,) = client.call(ListHardwareComponents, f"{MANAGER}/list_hardware_components").component
    assert component.rw_rate == RATE_HZ
    with client.hearing(DiagnosticArray, "/diagnostics") as received:
        client.spin_until(lambda: received)
    assert {value.key: value.value for value in received[0].status[0].values}["rate_hz"] == str(RATE_HZ)


@pytest.mark.row("cm-sim-time")
def test_sim_time_does_not_change_rate_and_stamps(client: ManagerClient, sim_time: Any) -> None:
    began_s = time.time()
    states = joint_states(client, 60)
    assert median(periods_s(states)) == pytest.approx(1.0 / RATE_HZ, rel=0.1)
    assert began_s - 10.0 < seconds(states[-1].header.stamp) < time.time() + 10.0


@pytest.mark.row("cm-sim-time")
def test_sim_time_does_not_change_the_stamps_of_other_topics(client: ManagerClient, sim_time: Any) -> None:
    began_s = time.time() - 10.0
    with (
        client.hearing(DiagnosticArray, "/diagnostics") as reports,
        client.hearing(ControllerManagerActivity, f"{MANAGER}/activity", LATCHED) as activity,
        client.hearing(TransitionEvent, "/hand_controller/transition_event") as events,
    ):
        client.spin_until(lambda: len(reports) >= 2)  # The timers of the nodes run although that clock stands still.
        assert client.switch((), ["hand_controller"])[0]
        client.spin_until(lambda: len(events) >= 2)
        assert client.switch(["hand_controller"])[0]
        client.spin_until(lambda: len(events) >= 4)
        client.spin_until(lambda: len(activity) >= 3)
    assert seconds(reports[-1].header.stamp) > began_s
    assert seconds(activity[-1].header.stamp) > began_s
    assert events[-1].timestamp * 1e-9 > began_s


@pytest.mark.row("cm-sim-time")
def test_sim_time_does_not_change_the_start_of_goals_and_is_logged(
    client: ManagerClient, sim_time: Any, stack: StackProcess
) -> None:
    arm = TrajectoryClient(stack)
    for pose in (PICK, READY):
        # In simulated time, both goals would start decades from now.
        sent = arm.send(goal_of(trajectory(point(pose, 2.0), stamp=arm.stamp(-1.0))))
        assert arm.outcome(sent)[0] == SUCCEEDED
    arm.close()
    assert "use_sim_time has no effect" in stack.words
