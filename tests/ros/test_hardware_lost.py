"""Hardware components that are lost and return, or that are missing at the start, as seen from another process."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from servoloop.stack.shipped_files import CONTROLLERS
from tests.ros.hardware_client import activate, components, controllers, interfaces, set_state
from tests.ros.hardware_plugin import DEFECT, Orders, install
from tests.ros.stack_process import READY, StackProcess, arm_client, running
from tests.ros.two_components import ARM, HAND, servos, write_robot_file, write_servos, write_urdf

pytestmark = pytest.mark.slow

SUCCEEDED = 4  # action_msgs/msg/GoalStatus


@contextmanager
def emulating(folder: Path, urdf: Path) -> Iterator[StackProcess]:
    """Run the virtual servos of the arm at ``folder``/bus."""
    link = folder / "bus"
    emulator = StackProcess(folder / "emulate.log", "emulate", str(link), "--urdf", str(urdf))
    try:
        emulator.wait_for(link)
        yield emulator
    finally:
        emulator.end()


@pytest.mark.row("trouble-unplugged", "cm-on-error", "trouble-nan")
def test_unplugged_arm_can_be_activated_again(ros_domain: int, tmp_path: Path) -> None:
    """The hand is a separate component and continues. If the last component is lost, ``--stay`` is needed."""
    urdf = write_urdf(tmp_path, arm=servos(write_robot_file(tmp_path, "arm", *ARM)))
    options = ("--urdf", str(urdf), "--port", str(tmp_path / "bus"), "--stay")
    with emulating(tmp_path, urdf) as emulator, running(tmp_path, *options) as stack, arm_client() as client:
        levels: dict[str, str] = {}
        client.node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: levels.update({s.name: s.message for s in m.status}), 10
        )
        positions: list[JointState] = []
        client.node.create_subscription(JointState, "/joint_states", positions.append, 10)
        emulator.end()
        client.spin_until(lambda: components(client) == {"arm": "unconfigured", "hand": "active"})
        states = controllers(client)
        assert (states["arm_controller"], states["hand_controller"]) == ("inactive", "active")
        assert set(interfaces(client, "joint").values()) == {(False, False)}
        assert interfaces(client, HAND)[f"commands/{HAND}/position"] == (True, True)
        client.spin_until(lambda: "has disappeared" in levels.get("servoloop: arm", ""))
        seen = len(positions)
        client.spin_until(lambda: len(positions) > seen + 5)
        assert len(positions[-1].name) == 8 and all(map(math.isfinite, positions[-1].position))
        assert set_state(client, "arm", label="active") == (False, "unconfigured")
        assert "does not exist" in stack.words
        with emulating(tmp_path, urdf):
            assert set_state(client, "arm", label="active") == (True, "active")
            assert activate(client, "arm_controller")[0]
            assert client.wait(client.send(READY)).status == SUCCEEDED
            assert stack.end() == 0, stack.words


@pytest.mark.row("trouble-unplugged", "cm-set-hardware")
def test_stack_without_stay_continues_with_one_component(ros_domain: int, tmp_path: Path) -> None:
    urdf = write_urdf(tmp_path, arm=servos(write_robot_file(tmp_path, "arm", *ARM)))
    with (
        emulating(tmp_path, urdf) as emulator,
        running(tmp_path, "--urdf", str(urdf), "--port", str(tmp_path / "bus")) as stack,
        arm_client() as client,
    ):
        emulator.end()
        client.spin_until(lambda: components(client) == {"arm": "unconfigured", "hand": "active"})
        assert set_state(client, "hand", label="finalized") == (True, "finalized")
        assert set_state(client, "hand", label="active") == (False, "finalized")
        assert stack.process.poll() is None
        assert stack.end() == 0, stack.words


@pytest.mark.row("trouble-nan", "cm-set-hardware")
def test_stack_with_stay_waits_for_missing_servos(ros_domain: int, tmp_path: Path) -> None:
    urdf = write_servos(tmp_path)
    link = tmp_path / "bus"
    ports = [word for name in ("arm", "hand") for word in ("--port", f"{name}={link}.{name}")]
    with running(tmp_path, "--urdf", str(urdf), "--stay", *ports) as stack, arm_client() as client:
        messages: list[JointState] = []
        client.node.create_subscription(JointState, "/joint_states", messages.append, 1000)
        assert components(client) == {"arm": "unconfigured", "hand": "unconfigured"}
        assert f"arm stays unconfigured: {link}.arm does not exist" in stack.words
        assert controllers(client)["joint_state_broadcaster"] == "active"
        emulator = StackProcess(tmp_path / "emulate.log", "emulate", str(link), "--urdf", str(urdf))
        try:
            for name in ("arm", "hand"):
                emulator.wait_for(tmp_path / f"bus.{name}")
                assert set_state(client, name, label="active") == (True, "active")
                known = [*ARM] if name == "arm" else ["hand_left_joint", HAND, *ARM]
                client.spin_until(lambda known=known: bool(messages) and messages[-1].name == known)
            assert activate(client, "arm_controller", "hand_controller")[0]
            # Without torque the arm lies on the stand. On a busy machine, it may rise too late for the first goal, so
            # a second goal is allowed.
            assert any(client.wait(client.send(READY)).status == SUCCEEDED for _ in range(2))
            # A joint is not reported until it has been measured.
            assert all(map(math.isfinite, (value for message in messages for value in message.position)))
            assert stack.end() == 0, stack.words
        finally:
            emulator.end()


@pytest.mark.row("trouble-unplugged")
def test_two_manufacturers_on_two_buses_and_both_buses_lost(ros_domain: int, tmp_path: Path) -> None:
    """Arm and hand are components with servos of different manufacturers. The emulator disconnects both components."""
    hand = tmp_path / "hand.yaml"
    urdf = write_servos(tmp_path)
    text = hand.read_text().replace("sts3215", "xl430-w250").replace("protocol: feetech", "protocol: dynamixel")
    robot = yaml.safe_load(text)
    for joint in robot["joints"].values():
        joint.pop("settings", None)  # servos of the other manufacturer
    hand.write_text(yaml.safe_dump(robot))
    link = tmp_path / "bus"
    ports = [word for name in ("arm", "hand") for word in ("--port", f"{name}={link}.{name}")]
    emulator = StackProcess(tmp_path / "emulate.log", "emulate", str(link), "--urdf", str(urdf))
    try:
        for name in ("arm", "hand"):
            emulator.wait_for(tmp_path / f"bus.{name}")
        with running(tmp_path, "--urdf", str(urdf), *ports) as stack, arm_client() as client:
            assert components(client) == {"arm": "active", "hand": "active"}
            assert client.wait(client.send(READY)).status == SUCCEEDED
            emulator.end()
            assert stack.process.wait(60.0) == 1
            assert "Traceback" not in stack.words
    finally:
        emulator.end()


def test_components_start_in_the_states_of_the_controllers_file(ros_domain: int, tmp_path: Path) -> None:
    controllers_file = tmp_path / "controllers.yaml"
    replacement = (
        "    update_rate: 20\n    hardware_components_initial_state: {unconfigured: [hand], inactive: [arm]}\n"
    )
    controllers_file.write_text(CONTROLLERS.read_text().replace("    update_rate: 20\n", replacement))
    options = ("--urdf", str(write_urdf(tmp_path)), "--controllers", str(controllers_file))
    with running(tmp_path, *options), arm_client() as client:
        assert components(client) == {"arm": "inactive", "hand": "unconfigured"}
        states = controllers(client)
        assert (states["arm_controller"], states["hand_controller"]) == ("inactive", "inactive")
        for name in ("arm", "hand"):
            assert set_state(client, name, label="active") == (True, "active")
        assert activate(client, "arm_controller", "hand_controller")[0]


@pytest.mark.row("cm-on-error-fails", "cm-set-hardware")
def test_component_whose_cleanup_fails_is_finalized(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = Orders(tmp_path / "hand")
    monkeypatch.setenv("PYTHONPATH", install(tmp_path))
    with (
        running(tmp_path, "--urdf", str(write_urdf(tmp_path, hand=hand.hardware))) as stack,
        arm_client() as client,
    ):
        hand.give("cleanup", "defect")
        hand.give("read", "lost")
        client.spin_until(lambda: components(client) == {"arm": "active", "hand": "finalized"})
        assert f"hand could not be cleaned up and stays unavailable: {DEFECT}" in stack.words
        hand.withdraw()
        for label in ("active", "inactive", "unconfigured"):
            assert set_state(client, "hand", label=label) == (False, "finalized")
        expected = "hand was not set to active: hand is permanently finalized: restart the stack to use it"
        client.spin_until(lambda: expected in stack.words)
        assert set(interfaces(client, "hand").values()) == {(False, False)}
        states = controllers(client)
        assert (states["hand_controller"], states["arm_controller"]) == ("inactive", "active")
        assert hand.calls[-1] == "cleanup"
        assert stack.end() == 1  # The exit status tells scripts about the failure.
        assert "deactivate" in hand.calls  # the last possible attempt
