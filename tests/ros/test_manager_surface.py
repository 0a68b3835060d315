"""The controller manager over DDS, asked from another process: a row for each row of the golden answers."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from control_msgs.action import FollowJointTrajectory
from controller_manager_msgs.msg import ControllerManagerActivity
from controller_manager_msgs.srv import (
    ListControllers,
    ListControllerTypes,
    LoadController,
    ReloadControllerLibraries,
    SetHardwareComponentState,
    SwitchController,
)
from lifecycle_msgs.msg import State, TransitionEvent
from rclpy.action import get_action_names_and_types
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

from servoloop.files import CONTROLLERS
from tests.ros.manager_client import MANAGER, ManagerClient, manager_client
from tests.ros.stack_process import StackProcess, running

pytestmark = pytest.mark.ros

FORWARD = "forward_command_controller/ForwardCommandController"
MORE = f"""
    conflict:
      type: {FORWARD}
    spare:
      type: {FORWARD}

conflict:
  ros__parameters: {{joints: [joint1], interface_name: position}}
spare:
  ros__parameters: {{joints: [joint6], interface_name: position}}
"""
DONE = "Successfully switched controllers!"
BEST_EFFORT, STRICT = 1, 2
AT_START = {
    "joint_state_broadcaster": "active",
    "arm_controller": "active",
    "hand_controller": "active",
    "conflict": "inactive",
    "spare": "inactive",
}


def controllers_file(folder: Path) -> Path:
    """The house's own file with two more controllers, whose joints are taken."""
    head, rest = CONTROLLERS.read_text().split("\narm_controller:\n")
    path = folder / "controllers.yaml"
    path.write_text(f"{head.rstrip()}\n{MORE}\narm_controller:\n{rest}")
    return path


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("manager")
    with running(folder, "--hardware", "mock", "--controllers", str(controllers_file(folder))) as stack:
        yield stack


@pytest.fixture(scope="module")
def connected(stack: StackProcess) -> Iterator[ManagerClient]:
    with manager_client() as client:
        yield client


@pytest.fixture
def client(connected: ManagerClient) -> Iterator[ManagerClient]:
    """The stack as it is after its start, whatever the test before has done."""
    yield connected
    for name, wanted in AT_START.items():
        state = connected.states().get(name)
        if state is None:
            assert connected.load(name)
        if state in (None, "unconfigured"):
            assert connected.configure(name)
        if state == "active" and wanted == "inactive":
            assert connected.switch((), [name])[0]
    for name in [n for n in connected.states() if n not in AT_START]:
        connected.switch((), [name], BEST_EFFORT)
        assert connected.unload(name)
    connected.switch([n for n, wanted in AT_START.items() if wanted == "active"], (), BEST_EFFORT)
    assert connected.states() == AT_START


# Who is there


def test_at_the_start_the_first_of_the_file_has_the_joint(client: ManagerClient, stack: StackProcess) -> None:
    assert client.states() == AT_START
    assert (
        "conflict stays inactive: Unable to activate controller 'conflict' since the command interface" in stack.words
    )


def test_list_controllers(client: ManagerClient) -> None:
    assert client.cleanup("spare")
    listed = {c.name: c for c in client.call(ListControllers, f"{MANAGER}/list_controllers").controller}
    arm, conflict, spare = listed["arm_controller"], listed["conflict"], listed["spare"]
    joints = [f"joint{i}/position" for i in range(1, 7)]
    assert (arm.type, arm.update_rate) == ("joint_trajectory_controller/JointTrajectoryController", 20)
    assert (arm.claimed_interfaces, arm.required_command_interfaces) == (joints, joints)
    assert sorted(arm.required_state_interfaces) == sorted([*joints, *(f"joint{i}/velocity" for i in range(1, 7))])
    assert (conflict.claimed_interfaces, conflict.required_command_interfaces) == ([], ["joint1/position"])
    assert (spare.state, spare.required_command_interfaces, spare.required_state_interfaces) == ("unconfigured", [], [])
    for c in listed.values():
        assert not (c.is_async or c.is_chainable or c.is_chained)
        assert c.reference_interfaces == c.exported_state_interfaces == c.chain_connections == []


def test_list_controller_types(client: ManagerClient) -> None:
    answer = client.call(ListControllerTypes, f"{MANAGER}/list_controller_types")
    assert {FORWARD, "joint_state_broadcaster/JointStateBroadcaster"} <= set(answer.types)
    assert answer.base_classes == ["controller_interface::ControllerInterface"] * len(answer.types)


def test_the_graph(client: ManagerClient) -> None:
    services = {
        f"{MANAGER}/{name}"
        for name in (
            "list_controllers",
            "list_controller_types",
            "list_hardware_components",
            "list_hardware_interfaces",
            "set_hardware_component_state",
            "load_controller",
            "configure_controller",
            "cleanup_controller",
            "unload_controller",
            "switch_controller",
            "reload_controller_libraries",
        )
    }
    client.spin_until(lambda: services <= {name for name, _ in client.node.get_service_names_and_types()})
    client.spin_until(lambda: set(AT_START) <= set(client.node.get_node_names()))
    topics = dict(client.node.get_topic_names_and_types())
    assert topics[f"{MANAGER}/activity"] == ["controller_manager_msgs/msg/ControllerManagerActivity"]
    assert topics["/arm_controller/transition_event"] == ["lifecycle_msgs/msg/TransitionEvent"]
    assert client.node.count_subscribers("/robot_description") >= 1


# Switching

KNOWN_AND_UNKNOWN = f"{DONE}\nActivated controllers: [ arm_controller ]"
NOPE = "Could not activate controller with name 'nope' because no controller with this name exists"
NOTHING = "After checking the controllers, no controllers need to be activated or deactivated."
CONFLICT = (
    "Unable to activate controller 'conflict' since the command interface 'joint1/position' is currently claimed "
    "by another controller."
)
SWITCHES = [
    (
        "already active, strict",
        ["arm_controller"],
        [],
        STRICT,
        False,
        "Controller with name 'arm_controller' is already active.",
    ),
    ("already active, best effort", ["arm_controller"], [], BEST_EFFORT, True, NOTHING),
    ("already active, nothing said", ["arm_controller"], [], 0, True, NOTHING),
    ("unknown only, strict", ["nope"], [], STRICT, False, NOPE),
    ("unknown only, best effort", ["nope"], [], BEST_EFFORT, False, NOPE),
    ("claim conflict, strict", ["conflict"], [], STRICT, False, CONFLICT),
    ("claim conflict, best effort", ["conflict"], [], BEST_EFFORT, False, CONFLICT),
    ("nobody", [], [], STRICT, True, NOTHING),
    ("no such strictness", ["arm_controller"], [], 9, False, "9 is not a valid Strictness"),
]


@pytest.mark.parametrize(
    ("activate", "deactivate", "strictness", "ok", "text"),
    [row[1:] for row in SWITCHES],
    ids=[row[0] for row in SWITCHES],
)
def test_a_switch_that_changes_nothing(
    client: ManagerClient, activate: list[str], deactivate: list[str], strictness: int, ok: bool, text: str
) -> None:
    assert client.switch(activate, deactivate, strictness) == (ok, text)
    assert client.states() == AT_START


def test_unknown_and_known(client: ManagerClient) -> None:
    assert client.switch((), ["arm_controller"])[0]
    assert client.switch(["nope", "arm_controller"], (), STRICT) == (False, NOPE)
    assert client.states()["arm_controller"] == "inactive"
    assert client.switch(["nope", "arm_controller"], (), BEST_EFFORT) == (True, KNOWN_AND_UNKNOWN)
    assert client.states()["arm_controller"] == "active"


def test_one_for_the_other_in_one_switch(client: ManagerClient) -> None:
    text = f"{DONE}\nDeactivated controllers: [ arm_controller ]\nActivated controllers: [ conflict spare ]"
    assert client.switch(["conflict", "spare"], ["arm_controller"]) == (True, text)
    text = f"{DONE}\nDeactivated controllers: [ conflict spare ]\nActivated controllers: [ arm_controller ]"
    assert client.switch(["arm_controller"], (), SwitchController.Request.FORCE_AUTO) == (True, text)


def test_inactive_hardware_refuses_who_commands_it_and_lets_others_look(client: ManagerClient) -> None:
    def set_hardware(label: str) -> None:
        state = State(label=label)
        service = f"{MANAGER}/set_hardware_component_state"
        assert client.call(SetHardwareComponentState, service, name="robot_arm", target_state=state).ok

    set_hardware("inactive")
    states = client.states()
    assert (states["arm_controller"], states["joint_state_broadcaster"]) == ("inactive", "active")
    ok, text = client.switch(["arm_controller"])
    assert not ok
    assert text.startswith(
        "Unable to activate controller 'arm_controller' since the command interface 'joint1/position' is not available"
    )
    assert client.switch((), ["joint_state_broadcaster"])[0] and client.switch(["joint_state_broadcaster"])[0]
    set_hardware("active")
    assert client.switch(["arm_controller"])[0]


# Life cycles

LIFE = [
    ("load unknown", "load", "nope"),
    ("load with no name", "load", ""),
    ("load with a bad type", "load", "bad"),
    ("load what is loaded", "load", "arm_controller"),
    ("configure unknown", "configure", "nope"),
    ("unload unknown", "unload", "nope"),
    ("clean up unknown", "cleanup", "nope"),
    ("unload active", "unload", "arm_controller"),
    ("configure active", "configure", "arm_controller"),
    ("clean up active", "cleanup", "arm_controller"),
]


@pytest.mark.parametrize(("verb", "name"), [row[1:] for row in LIFE], ids=[row[0] for row in LIFE])
def test_refused(client: ManagerClient, verb: str, name: str) -> None:
    assert client.set_from_text(MANAGER, "bad.type", "no_such/Type")
    assert not getattr(client, verb)(name)
    assert client.states() == AT_START


def test_clean_up_then_unload_then_load_again(client: ManagerClient) -> None:
    assert client.cleanup("conflict") and client.cleanup("conflict")
    assert client.states()["conflict"] == "unconfigured"
    assert client.switch(["conflict"])[0] is False
    assert client.unload("conflict")
    assert "conflict" not in client.states()
    client.spin_until(lambda: "conflict" not in client.node.get_node_names())
    assert client.load("conflict")
    assert client.states()["conflict"] == "unconfigured"


def test_the_action_comes_and_goes_with_the_configuration(client: ManagerClient) -> None:
    name = "/arm_controller/follow_joint_trajectory"

    def there() -> bool:
        return name in dict(get_action_names_and_types(client.node))

    assert client.switch((), ["arm_controller"])[0]
    client.spin_until(there)
    assert client.cleanup("arm_controller")
    client.spin_until(lambda: not there())
    assert client.configure("arm_controller") and client.configure("arm_controller")
    client.spin_until(there)
    assert client.switch(["arm_controller"])[0]
    client.spin_until(lambda: client.node.get_node_names().count("arm_controller") == 1)


def test_a_goal_that_ends_with_its_controller_still_gets_its_result(client: ManagerClient) -> None:
    from tests.ros.stack_process import PICK, ArmClient

    arm = ArmClient("goal_client")
    result = arm.send(PICK, seconds=5)
    assert client.switch((), ["arm_controller"])[0]
    assert client.cleanup("arm_controller")
    answer: Any = arm.wait(result)
    assert answer.result.error_code == FollowJointTrajectory.Result.INVALID_GOAL
    assert answer.result.error_string == "Current goal cancelled during deactivate transition."
    arm.close()


def test_reload_controller_libraries(client: ManagerClient) -> None:
    service = f"{MANAGER}/reload_controller_libraries"
    assert not client.call(ReloadControllerLibraries, service, force_kill=False).ok
    assert client.states() == AT_START
    assert client.call(ReloadControllerLibraries, service, force_kill=True).ok
    assert client.states() == {}


# Parameters


def test_the_managers_parameters(client: ManagerClient) -> None:
    assert client.get(MANAGER, "update_rate", "conflict.type") == [20, FORWARD]
    assert "<ros2_control" in client.get(MANAGER, "robot_description")[0]
    assert client.put(MANAGER, "update_rate", 30) == "parameter 'update_rate' cannot be set because it is read-only"
    assert client.get(MANAGER, "update_rate") == [20]


def test_the_controllers_parameters_under_upstreams_names(client: ManagerClient) -> None:
    names = client.parameters("/arm_controller")
    assert {"joints", "constraints.goal_time", "constraints.joint1.goal", "interpolation_method"} <= names
    assert client.get("/spare", "joints", "interface_name") == [["joint6"], "position"]


REFUSED = [
    ("interpolation_method", "none", "parameter 'interpolation_method' cannot be set because it is read-only"),
    ("joints", ["joint1"], "parameter 'joints' cannot be set because it is read-only"),
    ("constraints.goal_time", -1.0, "constraints.goal_time: Input should be greater than or equal to 0"),
    ("constraints.goal_time", float("nan"), "constraints.goal_time: Input should be a finite number"),
    ("constraints.joint1.goal", "wide", "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.STRING'"),
    ("nonsense", 1.0, "parameter 'nonsense' cannot be set because it was not declared"),
]


@pytest.mark.parametrize(("name", "value", "reason"), REFUSED)
def test_a_parameter_that_is_refused_stays(client: ManagerClient, name: str, value: Any, reason: str) -> None:
    before = client.get("/arm_controller", name)
    assert reason in client.put("/arm_controller", name, value)
    assert client.get("/arm_controller", name) == before


def test_a_parameter_that_can_be_set_outlives_a_new_configuration(client: ManagerClient) -> None:
    assert client.put("/arm_controller", "constraints.joint1.goal", 0.25) == ""
    assert client.switch((), ["arm_controller"])[0] and client.configure("arm_controller")
    assert client.get("/arm_controller", "constraints.joint1.goal") == [0.25]
    assert client.put("/arm_controller", "constraints.joint1.goal", 0.0) == ""


# What is told


def test_activity_is_told_on_every_change_and_to_latecomers(client: ManagerClient) -> None:
    seen: list[dict[str, str]] = []

    def note(message: ControllerManagerActivity) -> None:
        seen.append({c.name: c.state.label for c in (*message.controllers, *message.hardware_components)})

    qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = client.node.create_subscription(ControllerManagerActivity, f"{MANAGER}/activity", note, qos)
    client.spin_until(lambda: seen and seen[-1] == {**AT_START, "robot_arm": "active"})
    assert client.switch((), ["hand_controller"])[0]
    client.spin_until(lambda: seen[-1]["hand_controller"] == "inactive")
    client.node.destroy_subscription(subscription)


def test_transitions_are_told_as_upstream_tells_them(client: ManagerClient) -> None:
    seen: list[tuple[tuple[int, str], ...]] = []

    def note(message: TransitionEvent) -> None:
        parts = (message.transition, message.start_state, message.goal_state)
        seen.append(tuple((part.id, part.label) for part in parts))

    topic = "/hand_controller/transition_event"
    subscription = client.node.create_subscription(TransitionEvent, topic, note, 10)
    client.spin_until(subscription.get_publisher_count)
    assert client.switch((), ["hand_controller"])[0]
    client.spin_until(lambda: len(seen) >= 2)
    assert client.switch(["hand_controller"], ())[0]
    client.spin_until(lambda: len(seen) >= 4)
    inactive, active, activating, deactivating = (
        (2, "inactive"),
        (3, "active"),
        (13, "activating"),
        (14, "deactivating"),
    )
    assert seen == [
        ((4, "deactivate"), active, deactivating),
        ((40, "transition_success"), deactivating, inactive),
        ((3, "activate"), inactive, activating),
        ((30, "transition_success"), activating, active),
    ]
    client.node.destroy_subscription(subscription)


# Many at once


def test_fifty_that_list_and_a_burst_of_a_hundred_switches(client: ManagerClient, stack: StackProcess) -> None:
    # Every client hears the answers to all: one that keeps only the last ten can lose its own among them.
    all_of_them = QoSProfile(depth=1, history=HistoryPolicy.KEEP_ALL)

    def another(kind: Any, name: str) -> Any:
        return client.node.create_client(kind, f"{MANAGER}/{name}", qos_profile=all_of_them)

    listing = [another(ListControllers, "list_controllers") for _ in range(50)]
    switching = [another(SwitchController, "switch_controller") for _ in range(10)]
    loading = client.client(LoadController, f"{MANAGER}/load_controller")
    for one in (*listing, *switching):
        assert one.wait_for_service(60.0)

    def wish(number: int) -> SwitchController.Request:
        names = ["hand_controller"]
        start, stop = ([], names) if number % 2 == 0 else (names, [])
        return SwitchController.Request(activate_controllers=start, deactivate_controllers=stop, strictness=STRICT)

    lists = [one.call_async(ListControllers.Request()) for one in listing]
    switches = [switching[number % 10].call_async(wish(number)) for number in range(100)]
    loads = [loading.call_async(LoadController.Request(name="nope")) for _ in range(5)]
    assert all(len(answer.controller) == len(AT_START) for answer in client.wait(*lists))
    answers = client.wait(*switches)
    assert all(answer.ok or "hand_controller" in answer.message for answer in answers)
    assert sum(answer.ok for answer in answers) >= 2
    assert not any(answer.ok for answer in client.wait(*loads))
    assert stack.process.poll() is None and "Traceback" not in stack.words
    for one in (*listing, *switching):
        client.node.destroy_client(one)
