"""A controller is loaded before its parameters are known. The parameters are set on its node before it is
configured."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.ros.manager_bench import FORWARD
from tests.ros.manager_client import MANAGER, ManagerClient
from tests.ros.stack_process import StackProcess, running

pytestmark = pytest.mark.row("cm-late-parameters")

EMPTY = "controller_manager: {ros__parameters: {update_rate: 20}}\n"
TRAJECTORY = "joint_trajectory_controller/JointTrajectoryController"
GRIPPER = "parallel_gripper_action_controller/GripperActionController"


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("late")
    (folder / "empty.yaml").write_text(EMPTY)
    with running(folder, "--hardware", "mock", "--controllers", str(folder / "empty.yaml")) as stack:
        yield stack


@pytest.fixture
def client(connected: ManagerClient) -> Iterator[ManagerClient]:
    """Run a manager without controllers."""
    yield connected
    for name, state in connected.states().items():
        assert state != "active" or connected.switch((), [name])[0]
        assert connected.unload(name)


def load(client: ManagerClient, name: str, kind: str) -> None:
    """Use a unique controller name in each test, because a client may still call the service of an unloaded node."""
    assert client.set_from_text(MANAGER, f"{name}.type", kind)
    assert client.load(name)
    assert client.states()[name] == "unconfigured"


def test_controller_is_loaded_set_configured_and_activated(client: ManagerClient, stack: StackProcess) -> None:
    load(client, "fingers", FORWARD)
    assert client.get("/fingers", "joints", "interface_name", "deactivate_on_wrong_length") == [None, None, False]
    assert not client.configure("fingers")
    assert "fingers requires joints, interface_name: set them on its node /fingers" in stack.words
    assert client.put("/fingers", "joints", ["hand_right_joint"]) == ""
    assert not client.configure("fingers")
    assert "fingers requires interface_name: set it on its node /fingers" in stack.words
    assert client.put("/fingers", "interface_name", "position") == ""
    assert client.configure("fingers") and client.switch(["fingers"])[0]
    assert client.get("/fingers", "joints", "interface_name") == [["hand_right_joint"], "position"]
    assert client.listed()["fingers"].claimed_interfaces == ["hand_right_joint/position"]


def test_invalid_parameters_are_refused_when_set_or_configured(client: ManagerClient, stack: StackProcess) -> None:
    load(client, "thumb", FORWARD)
    assert "joints" in client.put("/thumb", "joints", [])
    assert client.put("/thumb", "joints", ["hand_right_joint"]) == ""
    assert client.put("/thumb", "interface_name", "smell") == ""  # an output of the URDF may have any name
    assert not client.configure("thumb")
    assert "needs hand_right_joint/smell, which is not a command_interface" in stack.words
    assert client.put("/thumb", "interface_name", "position") == ""
    assert client.put("/thumb", "joints", ["hand_right_joint", "hand_right_joint"]) == ""
    assert not client.configure("thumb")
    assert "thumb.joints names hand_right_joint twice" in stack.words
    assert client.put("/thumb", "joints", ["elbow"]) == ""
    assert not client.configure("thumb")
    assert "thumb.joints names elbow, which has no command_interface in the URDF" in stack.words
    assert client.states() == {"thumb": "unconfigured"}


def test_late_parameters_can_be_set_again_only_after_cleanup(client: ManagerClient) -> None:
    load(client, "grip", FORWARD)
    assert client.put("/grip", "interface_name", "position") == ""
    assert client.put("/grip", "joints", ["hand_right_joint"]) == ""
    assert client.configure("grip")
    assert "only before the controller is configured" in client.put("/grip", "joints", ["joint1"])
    assert client.get("/grip", "joints") == [["hand_right_joint"]]
    assert client.cleanup("grip")
    assert client.put("/grip", "joints", ["joint1"]) == ""
    assert client.configure("grip")
    assert client.listed()["grip"].required_command_interfaces == ["joint1/position"]


@pytest.mark.parametrize(
    ("kind", "name", "value", "claims"),
    [
        (TRAJECTORY, "joints", ["joint1", "joint2"], ["joint1/position", "joint2/position"]),
        (GRIPPER, "joint", "hand_right_joint", ["hand_right_joint/position"]),
    ],
    ids=["trajectory", "gripper"],
)
def test_trajectory_and_gripper_controllers_accept_late_parameters(
    client: ManagerClient, kind: str, name: str, value: object, claims: list[str]
) -> None:
    controller = f"late_{name}"
    load(client, controller, kind)
    assert client.put(f"/{controller}", name, value) == ""
    assert client.configure(controller) and client.switch([controller])[0]
    assert client.listed()[controller].claimed_interfaces == claims


def test_other_parameters_of_the_spawner_are_kept(client: ManagerClient, tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text("arm: {ros__parameters: {constraints: {goal_time: 2.5, joint1: {goal: 0.25}}}}\n")
    assert client.set_from_text(MANAGER, "arm.params_file", str([str(file)]))
    load(client, "arm", TRAJECTORY)
    known = ("constraints.goal_time", "constraints.joint1.goal")
    assert client.get("/arm", *known) == [2.5, 0.25]
    assert client.put("/arm", "joints", ["joint1", "joint2"]) == ""
    assert client.configure("arm")
    assert client.get("/arm", *known, "constraints.joint2.goal") == [2.5, 0.25, 0.0]
    assert client.put("/arm", "constraints.joint2.goal", 0.5) == ""
