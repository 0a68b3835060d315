"""The mock hardware in several blocks with different parameters, as seen from another process."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import pytest
from control_msgs.msg import DynamicJointState
from controller_manager_msgs.srv import ListHardwareComponents, ListHardwareInterfaces
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from tests.ros.manager_client import MANAGER, ManagerClient, manager_client
from tests.ros.mock_robot import FOLLOWER, MULTIPLIER, OFFSET_M, PERIOD_S, write_mocks
from tests.ros.stack_process import running
from tests.ros.two_components import HAND


@dataclass(frozen=True, slots=True)
class Seen:
    """One ``/joint_states`` message, by joint."""

    position: dict[str, float]
    velocity: dict[str, float]
    effort: dict[str, float]


class Bench:
    """Client that records the states of the stack and sends commands."""

    def __init__(self, client: ManagerClient) -> None:
        self.client = client
        self.seen: list[Seen] = []
        self.dynamic: list[DynamicJointState] = []
        node = client.node
        node.create_subscription(JointState, "/joint_states", self._take, 100)
        node.create_subscription(DynamicJointState, "/dynamic_joint_states", self.dynamic.append, 100)
        self._publishers = {
            name: node.create_publisher(Float64MultiArray, f"/{name}/commands", 10)
            for name in ("positions", "speeds", "efforts")
        }
        self.until(lambda: bool(self.seen and self.dynamic))
        self.until(lambda: all(p.get_subscription_count() for p in self._publishers.values()))
        self.first = self.seen[0]
        """State before the first command."""

    def _take(self, message: JointState) -> None:
        columns = (message.position, message.velocity, message.effort)
        self.seen.append(Seen(*(dict(zip(message.name, column, strict=True)) for column in columns)))

    def until(self, ready: Callable[[], bool]) -> None:
        self.client.spin_until(ready)

    def command(self, controller: str, *values: float) -> int:
        """Send a command and return the number of states received before it."""
        self._publishers[controller].publish(Float64MultiArray(data=values))
        return len(self.seen)

    def go(self, joint1: float, joint2: float, joint4: float, hand_m: float) -> list[Seen]:
        """Send positions. Return the states until the moving joints have arrived and some more time has passed."""
        wanted = {"joint1": joint1, "joint2": joint2, HAND: hand_m}
        begin = self.command("positions", joint1, joint2, joint4, hand_m)

        def arrived() -> bool:
            last = self.seen[begin:][-3:]
            there = [one.position[name] == p and not one.velocity[name] for one in last for name, p in wanted.items()]
            return len(last) == 3 and all(there)

        self.until(arrived)
        return self.seen[begin:]


@pytest.fixture(scope="module")
def bench(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("mocks")
    urdf, controllers = write_mocks(folder)
    options = ("--hardware", "mock", "--urdf", str(urdf), "--controllers", str(controllers))
    with running(folder, *options), manager_client() as client:
        yield Bench(client)


def interfaces(message: DynamicJointState, name: str) -> dict[str, float]:
    """Return the interface values of one joint."""
    listed = message.interface_values[message.joint_names.index(name)]
    return dict(zip(listed.interface_names, listed.values, strict=True))


@pytest.mark.row("cm-urdf-types", "cm-list-hardware")
def test_systems_actuators_and_sensors_are_separate_components(bench: Bench) -> None:
    listed = bench.client.call(ListHardwareComponents, f"{MANAGER}/list_hardware_components").component
    assert {c.name: (c.type, c.state.label) for c in listed} == {
        "plain-1": ("system", "active"),
        "smooth": ("actuator", "active"),
        "wheel": ("system", "active"),
        "stuck": ("system", "active"),
        "strong": ("system", "active"),
        "probe": ("sensor", "active"),
        "hand": ("system", "active"),
    }
    # Node names contain only letters, digits and underscores.
    names = {"plain_1", "smooth", "wheel", "stuck", "strong", "probe", "hand"}
    bench.until(lambda: names <= set(bench.client.node.get_node_names()))
    probe = next(c for c in listed if c.name == "probe")
    assert not probe.command_interfaces
    assert [i.name for i in probe.state_interfaces] == ["joint6/position", "joint6/velocity"]
    assert all(i.is_available and i.data_type == "double" for i in probe.state_interfaces)
    assert bench.first.position["joint6"] == -0.5


@pytest.mark.row("cm-urdf-initial")
def test_interfaces_start_at_their_initial_values_or_unknown(bench: Bench) -> None:
    """Positions and velocities of the mock default to 0, as in GenericSystem."""
    first = bench.first
    assert {name: first.position[name] for name in ("joint1", "joint4", "joint6")} == {
        "joint1": 0.25,
        "joint4": 0.125,
        "joint6": -0.5,
    }
    assert {first.position[name] for name in ("joint2", "joint3", "joint5", HAND)} == {0.0}
    assert set(first.velocity.values()) == {0.0}
    assert math.isnan(first.effort["joint1"])
    assert interfaces(bench.dynamic[0], "joint1")["heat"] == 21.5
    assert math.isnan(interfaces(bench.dynamic[0], "joint1")["effort"])
    assert math.isnan(interfaces(bench.dynamic[0], "joint1")["offset"])


@pytest.mark.row("cm-urdf-mimic")
def test_mimic_joint_has_states_but_no_commands(bench: Bench) -> None:
    listed = bench.client.call(ListHardwareInterfaces, f"{MANAGER}/list_hardware_interfaces")
    assert not [i.name for i in listed.command_interfaces if i.name.startswith(FOLLOWER)]
    states = [i.name for i in listed.state_interfaces if i.name.startswith(FOLLOWER)]
    assert states == [f"{FOLLOWER}/position", f"{FOLLOWER}/velocity"]
    assert bench.first.position[FOLLOWER] == pytest.approx(MULTIPLIER * bench.first.position[HAND] + OFFSET_M)


def differentiates(course: list[Seen], name: str) -> bool:
    """Return whether each change of position equals the velocity times a whole number of periods. States may be
    missing."""
    steady = [
        (before.position[name], after.position[name], after.velocity[name])
        for before, after in pairwise(course)
        if after.velocity[name] > 0.01 and abs(after.velocity[name] - before.velocity[name]) < 1e-9
    ]
    periods = [(after - before) / (velocity * PERIOD_S) for before, after, velocity in steady]
    return len(periods) > 2 and all(count > 0.5 and abs(count - round(count)) < 1e-6 for count in periods)


@pytest.mark.row("cm-mock-position", "cm-mock-dynamics", "cm-mock-mimic", "cm-mock-disabled", "cm-urdf-types")
def test_position_commands_are_mirrored_differentiated_and_mimicked(bench: Bench) -> None:
    course = bench.go(1.25, 1.9, 1.0, 0.04)
    assert {seen.velocity["joint1"] for seen in course} == {0.0}
    assert len({seen.position["joint1"] for seen in course}) > 3  # It was moving.
    assert differentiates(course, "joint2")
    assert max(seen.velocity["joint2"] for seen in course) == pytest.approx(4.0)  # limit of the joint
    assert {seen.position["joint4"] for seen in course} == {0.125}
    assert {seen.velocity["joint4"] for seen in course} == {0.0}
    for seen in course:
        assert seen.position[FOLLOWER] == pytest.approx(MULTIPLIER * seen.position[HAND] + OFFSET_M)
        assert seen.velocity[FOLLOWER] == pytest.approx(MULTIPLIER * seen.velocity[HAND])
    assert course[-1].position[FOLLOWER] == pytest.approx(0.0)
    assert min(seen.velocity[FOLLOWER] for seen in course) < 0.0
    assert {seen.position["joint6"] for seen in course} == {-0.5}  # state of the sensor


@pytest.mark.row("cm-mock-dynamics")
def test_velocity_command_moves_a_mock_or_replaced_servo(bench: Bench) -> None:
    begin = bench.command("speeds", 0.5)
    bench.until(lambda: bench.seen[-1].position["joint3"] > 0.3)
    assert differentiates(bench.seen[begin:], "joint3")
    assert bench.seen[-1].velocity["joint3"] == pytest.approx(0.5)
    before = bench.command("speeds", 0.0)
    bench.until(lambda: len([seen for seen in bench.seen[before:] if not seen.velocity["joint3"]]) > 3)
    assert bench.seen[-1].position["joint3"] == bench.seen[-2].position["joint3"] > 0.2


def test_effort_command_is_mirrored(bench: Bench) -> None:
    bench.command("efforts", 1.5)
    bench.until(lambda: bench.seen[-1].effort["joint5"] == 1.5)
    assert bench.seen[-1].position["joint5"] == 0.0
