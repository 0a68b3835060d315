"""A user's hardware component in a running stack: its calls and its failures."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from control_msgs.msg import DynamicJointState, JointTrajectoryControllerState
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState

from tests.ros.hardware_client import activate, components, controllers, interfaces, set_state
from tests.ros.hardware_plugin import DEFECT, GONE, Orders, install
from tests.ros.stack_process import READY, ArmClient, StackProcess, arm_client, running
from tests.ros.two_components import HAND, add_states, write_urdf

ABORTED = 6  # action_msgs/msg/GoalStatus
HZ = 20
BACKGROUND = {"hand_controller": "active", "joint_state_broadcaster": "active"}
"""Controllers that do not use the component of the arm."""


@dataclass(frozen=True, slots=True)
class Sample:
    """State of the arm's first joint in one ``/dynamic_joint_states`` message."""

    stamp_s: float
    position: float
    reads: float
    writes: float


class Bench:
    """The stack with the plugin as the arm, and the states that it publishes."""

    def __init__(self, stack: StackProcess, client: ArmClient, arm: Orders) -> None:
        self.stack, self.client, self.arm = stack, client, arm
        self.samples: list[Sample] = []
        self.joint_states: list[JointState] = []
        client.node.create_subscription(DynamicJointState, "/dynamic_joint_states", self._take, 100)
        client.node.create_subscription(JointState, "/joint_states", self.joint_states.append, 100)
        client.spin_until(lambda: bool(self.samples and self.joint_states))

    def _take(self, message: DynamicJointState) -> None:
        index = message.joint_names.index("joint1")
        listed = message.interface_values[index]
        values = dict(zip(listed.interface_names, listed.values, strict=True))
        stamp = message.header.stamp
        self.samples.append(
            Sample(stamp.sec + stamp.nanosec * 1e-9, values["position"], values["reads"], values["writes"])
        )

    def bring_back(self) -> None:
        """Wait until all components are active and without faults."""
        self.arm.withdraw()
        assert set_state(self.client, "arm", label="active") == (True, "active")
        if controllers(self.client)["arm_controller"] != "active":
            assert activate(self.client, "arm_controller")[0]

    def move(self) -> object:
        """Start a long motion and return the future of its result."""
        begin = self.samples[-1].position
        result = self.client.send([begin + 0.8, *READY[1:]], seconds=8)
        self.client.spin_until(lambda: self.samples[-1].position > begin + 0.05)
        return result


@pytest.fixture(scope="module")
def running_bench(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("plugin")
    arm = Orders(folder / "arm")
    urdf = add_states(write_urdf(folder, arm=arm.hardware), "joint1", "reads", "writes")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", install(folder))
        with running(folder, "--urdf", str(urdf)) as stack, arm_client() as client:
            yield Bench(stack, client, arm)


@pytest.fixture
def bench(running_bench: Bench) -> Bench:
    running_bench.bring_back()
    return running_bench


@pytest.mark.row("cm-inactive-hardware", "trouble-python")
def test_inactive_hardware_is_read_and_not_written(bench: Bench) -> None:
    assert set_state(bench.client, "arm", label="inactive") == (True, "inactive")

    def only_read() -> bool:
        last = bench.samples[-6:]
        return last[-1].reads - last[0].reads >= 5 and last[-1].writes == last[0].writes

    bench.client.spin_until(only_read)
    assert interfaces(bench.client, "joint1") == {
        "commands/joint1/position": (True, False),
        **{f"states/joint1/{kind}": (True, False) for kind in ("reads", "writes", "position", "velocity")},
    }
    bench.arm.give("pose", -0.3)  # moved by hand: the measured position is still published
    bench.client.spin_until(lambda: bench.samples[-1].position == -0.3)
    written = bench.samples[-1].writes
    assert set_state(bench.client, "arm", label="active") == (True, "active")
    bench.client.spin_until(lambda: bench.samples[-1].writes > written + 3)
    assert bench.samples[-1].position == -0.3


@pytest.mark.row("cm-set-hardware")
def test_activation_from_unconfigured_configures_first(bench: Bench) -> None:
    begin = len(bench.arm.calls)
    assert set_state(bench.client, "arm", label="unconfigured") == (True, "unconfigured")
    assert set_state(bench.client, "arm", label="active") == (True, "active")
    assert bench.arm.calls[begin:] == ["deactivate", "cleanup", "configure", "activate"]


@pytest.mark.row("cm-set-hardware")
@pytest.mark.parametrize(("call", "stays"), [("configure", "unconfigured"), ("activate", "inactive")])
@pytest.mark.parametrize(("order", "expected"), [("lost", GONE), ("defect", DEFECT)])
def test_failed_transition_is_logged_and_the_last_state_is_kept(
    bench: Bench, call: str, stays: str, order: str, expected: str
) -> None:
    assert set_state(bench.client, "arm", label="unconfigured") == (True, "unconfigured")
    bench.arm.give(call, order)
    assert set_state(bench.client, "arm", label="active") == (False, stays)
    bench.client.spin_until(lambda: f"arm was not set to active: {expected}" in bench.stack.words)


@pytest.mark.row("cm-on-error", "trouble-fault", "trouble-nan")
@pytest.mark.parametrize(("order", "expected"), [("lost", GONE), ("defect", DEFECT)])
def test_fault_during_a_motion_ends_the_goal_and_the_component_returns_in_place(
    bench: Bench, order: str, expected: str
) -> None:
    """Other components and the broadcaster continue. ros2_control also deactivates the broadcaster."""
    client = bench.client
    result = bench.move()
    bench.arm.give("read", order)
    answer = client.wait(result)
    assert answer.status == ABORTED
    text = "Current goal cancelled during deactivate transition."
    assert answer.result.error_string == f"{text} arm is lost: {expected}"
    client.spin_until(lambda: components(client) == {"arm": "unconfigured", "hand": "active"})
    assert controllers(client) == {"arm_controller": "inactive", **BACKGROUND}
    assert set(interfaces(client, "joint").values()) == {(False, False)}
    assert interfaces(client, HAND)[f"commands/{HAND}/position"] == (True, True)
    assert {available for available, _ in interfaces(client, "hand").values()} == {True}
    ok, message = activate(client, "arm_controller")
    assert not ok and "command interface 'joint1/position' is not available" in message
    seen = len(bench.joint_states)
    client.spin_until(lambda: len(bench.joint_states) > seen + 3)
    assert all(map(math.isfinite, bench.joint_states[-1].position))  # the last known position
    assert len(bench.joint_states[-1].name) == 8

    bench.arm.give("pose", -0.4)  # moved by hand meanwhile
    bench.arm.withdraw("read")
    outputs: list[float] = []
    client.node.create_subscription(
        JointTrajectoryControllerState,
        "/arm_controller/controller_state",
        lambda message: outputs.append(message.output.positions[0]),
        100,
    )
    bench.bring_back()
    back = len(bench.samples)
    client.spin_until(lambda: len(outputs) > 10 and len(bench.samples) > back + 10)
    assert outputs == [-0.4] * len(outputs)  # regardless of the goal
    assert {sample.position for sample in bench.samples[back:]} == {-0.4}


@pytest.mark.row("cm-on-error", "cm-write-deactivate")
@pytest.mark.parametrize(("order", "expected"), [("lost", GONE), ("defect", DEFECT)])
def test_component_with_a_failed_write_is_lost_and_not_inactive(bench: Bench, order: str, expected: str) -> None:
    result = bench.move()
    begin = len(bench.arm.calls)
    bench.arm.give("write", order)
    assert bench.client.wait(result).result.error_string.endswith(f"arm is lost: {expected}")
    seen: list[str] = []
    bench.client.spin_until(lambda: seen.append(components(bench.client)["arm"]) or seen[-1] == "unconfigured")
    assert "inactive" not in seen
    assert bench.arm.calls[begin:] == ["cleanup"]
    assert controllers(bench.client) == {"arm_controller": "inactive", **BACKGROUND}


@pytest.mark.row("cm-write-deactivate")
def test_component_that_deactivates_itself_is_lost_and_its_goals_fail(bench: Bench) -> None:
    """A component cannot request its own deactivation. A component either works or is lost."""
    result = bench.move()
    bench.arm.give("write", "rest")
    answer = bench.client.wait(result)
    assert answer.status == ABORTED
    assert answer.result.error_string.endswith("arm is lost: it became inactive without a request")
    bench.client.spin_until(lambda: components(bench.client)["arm"] == "unconfigured")
    assert controllers(bench.client) == {"arm_controller": "inactive", **BACKGROUND}


@pytest.mark.row("cm-overruns")
def test_cycles_missed_by_a_slow_component_are_skipped_with_a_warning(bench: Bench) -> None:
    reports: list[DiagnosticStatus] = []
    bench.client.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda message: reports.append(message.status[0]), 10
    )
    before = bench.samples[-1]
    bench.arm.give("read", 0.6)  # twelve periods
    bench.client.spin_until(lambda: bench.samples[-1].reads > before.reads + 25)
    after = bench.samples[-1]
    due = (after.stamp_s - before.stamp_s) * HZ
    # If missed cycles were repeated, the count would equal the number of due cycles.
    assert after.reads - before.reads < due - 6
    assert max(int(count) for count in re.findall(r"missed (\d+) cycles? of", bench.stack.words)) >= 10
    bench.client.spin_until(lambda: bool(reports) and "cycles missed" in reports[-1].message)
    assert reports[-1].level == DiagnosticStatus.WARN
    assert int({value.key: value.value for value in reports[-1].values}["missed_cycles"]) >= 10
