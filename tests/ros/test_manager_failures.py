"""Controllers that fail or block the loop: behavior of the other controllers and responses to clients, over ROS."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from controller_manager_msgs.msg import ControllerManagerActivity
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from tests.ros.manager_bench import DONE, FORWARD
from tests.ros.manager_client import MANAGER, ManagerClient
from tests.ros.stack_process import StackProcess, running

LATCHED = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HAND = "hand_right_joint"
CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    troublesome: {{type: test/Troublesome, fallback_controllers: [spare]}}
    alone: {{type: test/Troublesome}}
    spare: {{type: {forward}}}
    hand: {{type: {forward}}}
troublesome: {{ros__parameters: {{joint: joint6, holdup: {holdup}}}}}
alone: {{ros__parameters: {{joint: joint1}}}}
spare: {{ros__parameters: {{joints: [joint6], interface_name: position}}}}
hand: {{ros__parameters: {{joints: [hand_right_joint], interface_name: position}}}}
"""
AT_START = {
    "joint_state_broadcaster": "active",
    "troublesome": "active",
    "alone": "active",
    "spare": "inactive",
    "hand": "active",
}
RAISED = "RuntimeError: the gripper's camera is dark"
FAULTS = [
    ("raises", RAISED),
    ("too many", "ValueError: the command has shape (2,), expected (1,)"),
    ("too few", "ValueError: the command has shape (0,), expected (1,)"),
]


@pytest.fixture(scope="module")
def holdup(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The loop can be blocked while this file exists."""
    return tmp_path_factory.mktemp("failures") / "holdup"


@pytest.fixture(scope="module")
def stack(ros_domain: int, holdup: Path) -> Iterator[StackProcess]:
    """Run the stack with the plugin installed as pip would install it."""
    folder = holdup.parent
    info = folder / "troublesome-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: troublesome\nVersion: 1.0\n")
    entry = "test/Troublesome = tests.ros.manager_plugins:Troublesome"
    (info / "entry_points.txt").write_text(f"[servoloop.controllers]\n{entry}\n")
    controllers = folder / "controllers.yaml"
    controllers.write_text(CONTROLLERS.format(forward=FORWARD, holdup=holdup))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder))
        with running(folder, "--hardware", "mock", "--controllers", str(controllers)) as stack:
            yield stack


@pytest.fixture
def client(connected: ManagerClient) -> Iterator[ManagerClient]:
    """Restore the initial state of the stack."""
    assert connected.states() == AT_START
    yield connected
    for name in ("troublesome", "alone"):
        assert connected.put(f"/{name}", "fault", "none") == ""
    states = connected.states()
    start = [name for name, state in AT_START.items() if state == "active" != states[name]]
    stop = ["spare"] if states["spare"] == "active" else []
    assert connected.switch(start, stop)[0]


def move_the_hand(client: ManagerClient, position_m: float) -> None:
    """Move the arm and return when it has arrived. The controller of the arm and the broadcaster must be unaffected."""
    publisher = client.node.create_publisher(Float64MultiArray, "/hand/commands", 1)
    with client.hearing(JointState, "/joint_states") as heard:

        def there() -> bool:
            # Send repeatedly, because a best-effort subscriber may not have discovered the new publisher yet.
            publisher.publish(Float64MultiArray(data=[position_m]))
            return bool(heard) and abs(heard[-1].position[heard[-1].name.index(HAND)] - position_m) < 1e-6

        client.spin_until(there)
    client.node.destroy_publisher(publisher)


# A controller with a failing update


@pytest.mark.row("cm-update-error", "trouble-python")
@pytest.mark.parametrize(("fault", "why"), FAULTS)
def test_failed_controller_is_deactivated_and_its_fallback_takes_over(
    client: ManagerClient, stack: StackProcess, fault: str, why: str
) -> None:
    before = stack.words.count(why)
    with client.hearing(ControllerManagerActivity, f"{MANAGER}/activity", LATCHED) as activity:
        assert client.put("/troublesome", "fault", fault) == ""
        client.spin_until(lambda: client.states()["troublesome"] == "inactive")
        changed = {**AT_START, "troublesome": "inactive", "spare": "active"}
        assert client.states() == changed
        client.spin_until(lambda: {c.name: c.state.label for c in activity[-1].controllers} == changed)
    listed = client.listed()
    assert (listed["troublesome"].claimed_interfaces, listed["spare"].claimed_interfaces) == ([], ["joint6/position"])
    assert "troublesome failed and is being deactivated: its joints are brought to rest" in stack.words
    assert stack.words.count(why) == before + 1
    move_the_hand(client, 0.02)
    move_the_hand(client, 0.03)


@pytest.mark.row("cm-update-error")
def test_failed_controller_without_fallback_releases_its_joint(client: ManagerClient, stack: StackProcess) -> None:
    assert client.put("/alone", "fault", "raises") == ""
    client.spin_until(lambda: client.states()["alone"] == "inactive")
    assert client.states() == {**AT_START, "alone": "inactive"}
    assert "alone failed and is being deactivated" in stack.words
    move_the_hand(client, 0.01)
    # Its state is unchanged. The controller fails again immediately, and it can be activated after a repair.
    assert client.switch(["alone"]) == (True, f"{DONE}\nActivated controllers: [ alone ]")
    client.spin_until(lambda: client.states()["alone"] == "inactive")
    assert client.put("/alone", "fault", "none") == "" and client.switch(["alone"])[0]
    move_the_hand(client, 0.02)
    assert client.states() == AT_START


# A blocked loop


@contextmanager
def held_up(client: ManagerClient, stack: StackProcess, holdup: Path) -> Iterator[None]:
    """Block all cycles until the end of the block. The ROS thread continues."""
    said = "troublesome holds the loop up"
    before = stack.words.count(said)
    holdup.touch()
    try:
        assert client.put("/troublesome", "fault", "waits") == ""
        client.spin_until(lambda: stack.words.count(said) > before)
        yield
    finally:
        holdup.unlink()


@pytest.mark.row("cm-switch-timeout")
def test_timeout_0_means_one_second_and_then_nothing_is_switched(
    client: ManagerClient, stack: StackProcess, holdup: Path
) -> None:
    with client.hearing(DiagnosticArray, "/diagnostics") as seconds, held_up(client, stack, holdup):
        late = client.switching((), ["hand"], timeout_s=0)
        later = client.switching((), ["joint_state_broadcaster"], timeout_s=2)
        in_time = client.switching((), ["alone"], timeout_s=60)
        told = len(seconds)
        client.spin_until(lambda: len(seconds) >= told + 4)  # once per second, according to the clock of the stack
        assert not (late.done() or later.done() or in_time.done())
    answers = client.wait(late, later, in_time)
    assert [(answer.ok, answer.message) for answer in answers] == [
        (False, "Switch controller timed out after 1.000000 seconds! Nothing was switched."),
        (False, "Switch controller timed out after 2.000000 seconds! Nothing was switched."),
        (True, f"{DONE}\nDeactivated controllers: [ alone ]"),
    ]
    assert client.states() == {**AT_START, "alone": "inactive"}


@pytest.mark.row("cm-switch-timeout")
def test_timeout_0_waits_for_the_next_cycle(client: ManagerClient) -> None:
    """The loop performs a switch in its next cycle, which comes within a second."""
    (answer,) = client.wait(client.switching((), ["hand"], timeout_s=0))
    assert (answer.ok, client.states()["hand"]) == (True, "inactive")


def test_list_services_respond_while_the_loop_is_blocked(
    client: ManagerClient, stack: StackProcess, holdup: Path
) -> None:
    with held_up(client, stack, holdup):
        assert client.states() == AT_START
