"""Make the same calls as the ros2_control spawner with a client of our own, from another process.

The spawner first calls ``list_controllers``. If the controller is not loaded, it sets the parameters
``NAME.node_options_args``, ``NAME.params_file`` (a list), ``NAME.type`` and ``NAME.fallback_controllers`` of the
manager from text and calls ``load_controller``. It then calls ``configure_controller`` and ``switch_controller``
(strict, with a timeout of 5 s). If it is killed with ``--unload-on-kill``, it deactivates strictly and unloads. The
spawner repeats a call without a response after 10 s, up to three times.
"""

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from controller_manager_msgs.srv import (
    ConfigureController,
    ListControllers,
    LoadController,
    SwitchController,
    UnloadController,
)
from std_msgs.msg import Float64MultiArray

from tests.ros.manager_client import MANAGER, ManagerClient
from tests.ros.stack_process import StackProcess, running

NAMESPACES = ["", pytest.param("/lab/left", marks=pytest.mark.slow)]
pytestmark = pytest.mark.parametrize("namespace", NAMESPACES, scope="module")

FORWARD = "forward_command_controller/ForwardCommandController"
EMPTY = "controller_manager: {ros__parameters: {update_rate: 20}}\n"
ARM = """
/**/arm:
  ros__parameters:
    type: joint_trajectory_controller/JointTrajectoryController
    joints: [joint1, joint2, joint3, joint4, joint5, joint6]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    fallback_controllers: [spare]
/**/spare:
  ros__parameters: {joints: [joint1], interface_name: position}
/**:
  ros__parameters: {use_sim_time: false}
"""
HAND = f"/**/hand: {{ros__parameters: {{type: {FORWARD}, joints: [hand_right_joint], interface_name: position}}}}\n"
NARROW = "/**/hand: {ros__parameters: {joints: [hand_right_joint, joint6]}}\n"


class Spawner:
    """Client that makes the calls of the ros2_control spawner in the same order."""

    def __init__(self, client: ManagerClient) -> None:
        self.client = client

    def spawn(
        self,
        name: str,
        *,
        files: Sequence[Path] = (),
        kind: str = "",
        fallback: Sequence[str] = (),
        ros_args: Sequence[str] = (),
        load_only: bool = False,
        inactive: bool = False,
    ) -> str:
        """Spawn a controller and return the failed step, or an empty string."""
        if name not in self.client.states():
            settings = {
                "node_options_args": str(list(ros_args)) if ros_args else "",
                "params_file": str([str(path) for path in files]) if files else "",
                "type": kind,
                "fallback_controllers": str(list(fallback)) if fallback else "",
            }
            for key, text in settings.items():
                if text and not self.client.set_from_text(MANAGER, f"{name}.{key}", text):
                    return f"set {key}"
            if not self.client.load(name):
                return "load"
        if load_only:
            return ""
        if not self.client.configure(name):
            return "configure"
        return "" if inactive or self._switch([name], []) else "activate"

    def unload(self, name: str) -> str:
        """Deactivate and unload the controller, as the spawner does with ``--unload-on-kill``."""
        if not self._switch([], [name]):
            return "deactivate"
        return "" if self.client.unload(name) else "unload"

    def _switch(self, activate: list[str], deactivate: list[str]) -> bool:
        answer = self.client.call(
            SwitchController,
            f"{MANAGER}/switch_controller",
            activate_controllers=activate,
            deactivate_controllers=deactivate,
            strictness=SwitchController.Request.STRICT,
            activate_asap=True,
            timeout=Duration(sec=5),
        )
        return bool(answer.ok)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a controllers file without controllers, and parameter files with controllers."""
    folder = tmp_path_factory.mktemp("spawner")
    for name, text in (("empty", EMPTY), ("arm", ARM), ("hand", HAND), ("narrow", NARROW)):
        (folder / f"{name}.yaml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def stack(ros_domain: int, files: Path, namespace: str) -> Iterator[StackProcess]:
    empty = str(files / "empty.yaml")
    with running(files, "--hardware", "mock", "--controllers", empty, "--namespace", namespace) as stack:
        yield stack


@pytest.fixture
def spawner(connected: ManagerClient) -> Iterator[Spawner]:
    """Run a manager without controllers."""
    yield Spawner(connected)
    for name, state in connected.states().items():
        assert state != "active" or connected.switch((), [name])[0]
        assert connected.unload(name)


@pytest.mark.row("cm-spawner")
def test_spawner_fills_a_stack_without_controllers(spawner: Spawner, files: Path) -> None:
    assert spawner.client.states() == {}
    kind = "joint_state_broadcaster/JointStateBroadcaster"
    assert spawner.spawn("joint_state_broadcaster", kind=kind) == ""
    kind = "joint_trajectory_controller/JointTrajectoryController"
    assert spawner.spawn("arm", files=[files / "arm.yaml"], kind=kind, fallback=["spare"]) == ""
    assert spawner.spawn("hand", files=[files / "hand.yaml"], kind=FORWARD) == ""
    assert set(spawner.client.states().values()) == {"active"}
    listed = {c.name: c for c in spawner.client.call(ListControllers, f"{MANAGER}/list_controllers").controller}
    assert listed["hand"].claimed_interfaces == ["hand_right_joint/position"]
    assert spawner.client.get("/arm", "joints") == [[f"joint{i}" for i in range(1, 7)]]
    # The controller is already loaded, so the spawner only configures it, which is refused for an active controller.
    assert spawner.spawn("hand", files=[files / "hand.yaml"], kind=FORWARD) == "configure"


@pytest.mark.row("cm-spawner")
def test_controller_is_only_loaded_or_left_inactive(spawner: Spawner, files: Path) -> None:
    given = {"files": [files / "hand.yaml"], "kind": FORWARD}
    assert spawner.spawn("hand", **given, load_only=True) == ""  # type: ignore[arg-type]
    assert spawner.client.states() == {"hand": "unconfigured"}
    assert spawner.spawn("hand", **given, inactive=True) == ""  # type: ignore[arg-type]
    assert spawner.client.states() == {"hand": "inactive"}
    assert spawner.spawn("hand", **given) == ""  # type: ignore[arg-type]
    assert spawner.client.states() == {"hand": "active"}


@pytest.mark.row("cm-spawner")
def test_controller_is_spawned_again_with_other_parameters(spawner: Spawner, files: Path) -> None:
    assert spawner.spawn("hand", files=[files / "hand.yaml"], kind=FORWARD) == ""
    assert spawner.unload("hand") == ""
    assert spawner.client.states() == {}
    assert spawner.unload("hand") == "deactivate"
    both = [files / "hand.yaml", files / "narrow.yaml"]
    assert spawner.spawn("hand", files=both, kind=FORWARD) == ""
    assert spawner.client.get("/hand", "joints") == [["hand_right_joint", "joint6"]]


@pytest.mark.row("cm-spawner")
def test_node_arguments_rename_a_topic(spawner: Spawner, files: Path) -> None:
    given = ["--ros-args", "-r", "hand/commands:=/fingers"]
    assert spawner.spawn("hand", files=[files / "hand.yaml"], kind=FORWARD, ros_args=given) == ""
    node = spawner.client.node
    spawner.client.spin_until(lambda: node.count_subscribers("/fingers") == 1)
    publisher = node.create_publisher(Float64MultiArray, "/fingers", 1)
    spawner.client.spin_until(lambda: publisher.get_subscription_count() == 1)
    node.destroy_publisher(publisher)


@pytest.mark.row("cm-spawner", "cm-load")
@pytest.mark.parametrize(
    ("name", "file", "kind", "step", "said"),
    [
        ("hand", "hand", "", "load", "The 'type' param was not defined for 'hand'"),
        ("hand", "hand", "no/Such", "load", "hand has unknown type 'no/Such'; known types are"),
        ("hand", "nowhere", FORWARD, "load", "cannot read"),
        ("hand", "arm", FORWARD, "configure", "hand requires joints, interface_name: set them on its node"),
        ("hand", "narrow", FORWARD, "configure", "hand requires interface_name: set it on its node"),
    ],
)
def test_failed_load_or_configuration_is_logged(
    spawner: Spawner, stack: StackProcess, files: Path, name: str, file: str, kind: str, step: str, said: str
) -> None:
    # The manager still has the parameters that earlier tests have set.
    assert spawner.client.set_from_text(MANAGER, f"{name}.type", kind or "''")
    assert spawner.spawn(name, files=[files / f"{file}.yaml"], kind=kind) == step
    assert said in stack.words
    assert spawner.client.states() == ({name: "unconfigured"} if step == "configure" else {})


# Late responses


@contextmanager
def stopped(stack: StackProcess) -> Iterator[None]:
    """Stop the whole process of the stack until the end of the block."""
    stack.process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        stack.process.send_signal(signal.SIGCONT)


def repeated(stack: StackProcess, client: ManagerClient, kind: Any, service: str, **fields: Any) -> list[bool]:
    """Return, for each of three identical requests, whether it is granted. All of these clients wait for the stack."""
    caller, request = client.client(kind, f"{MANAGER}/{service}"), kind.Request(**fields)
    with stopped(stack):
        futures = [caller.call_async(request) for _ in range(3)]
    return [bool(answer.ok) for answer in client.wait(*futures)]


@pytest.mark.row("cm-spawner")
def test_repeated_requests_after_a_late_response_are_handled(
    spawner: Spawner, stack: StackProcess, files: Path
) -> None:
    client = spawner.client
    assert client.set_from_text(MANAGER, "hand.type", FORWARD)
    assert client.set_from_text(MANAGER, "hand.params_file", str([str(files / "hand.yaml")]))
    assert repeated(stack, client, LoadController, "load_controller", name="hand") == [True, False, False]
    assert client.states() == {"hand": "unconfigured"}
    assert repeated(stack, client, ConfigureController, "configure_controller", name="hand") == [True] * 3
    assert client.states() == {"hand": "inactive"}
    switch = {"strictness": SwitchController.Request.STRICT, "activate_asap": True, "timeout": Duration(sec=5)}
    start = {"activate_controllers": ["hand"], **switch}
    assert repeated(stack, client, SwitchController, "switch_controller", **start) == [True, False, False]
    assert client.states() == {"hand": "active"}
    client.spin_until(lambda: client.node.get_node_names().count("hand") == 1)
    stop = {"deactivate_controllers": ["hand"], **switch}
    assert repeated(stack, client, SwitchController, "switch_controller", **stop) == [True, False, False]
    assert repeated(stack, client, UnloadController, "unload_controller", name="hand") == [True, False, False]
    assert client.states() == {}


@pytest.mark.row("cm-spawner")
def test_second_spawner_completes_the_work_of_the_first(spawner: Spawner, stack: StackProcess, files: Path) -> None:
    """The second spawner finds the late results of the first one and continues from that state."""
    client = spawner.client
    assert spawner.spawn("hand", files=[files / "hand.yaml"], kind=FORWARD, load_only=True) == ""
    assert repeated(stack, client, LoadController, "load_controller", name="hand") == [False] * 3
    assert spawner.spawn("hand", files=[files / "hand.yaml"], kind=FORWARD) == ""
    assert client.states() == {"hand": "active"}
