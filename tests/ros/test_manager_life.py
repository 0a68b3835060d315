"""Load, configure, clean up and unload controllers over ROS, with the same responses as ros2_control."""

from typing import Any

import pytest
from control_msgs.action import FollowJointTrajectory
from controller_manager_msgs.srv import ListControllers, LoadController, ReloadControllerLibraries, SwitchController
from lifecycle_msgs.msg import TransitionEvent
from rclpy.action import get_action_names_and_types
from rclpy.qos import HistoryPolicy, QoSProfile

from tests.ros.manager_bench import AT_START
from tests.ros.manager_client import MANAGER, STRICT, ManagerClient
from tests.ros.stack_process import PICK, ArmClient, StackProcess

NAMESPACES = ["", pytest.param("/lab/left", marks=pytest.mark.slow)]
pytestmark = pytest.mark.parametrize("namespace", NAMESPACES, scope="module")


def refused(case: str, verb: str, name: str, expected: str) -> Any:
    return pytest.param(verb, name, expected, id=case, marks=pytest.mark.row("golden-not-ok", f"cm-{verb}"))


@pytest.mark.parametrize(
    ("verb", "name", "expected"),
    [
        refused("load unknown", "load", "nope", "The 'type' param was not defined for 'nope'"),
        refused("load with no name", "load", "", "The 'type' param was not defined for ''"),
        refused("load with a bad type", "load", "bad", "bad has unknown type 'no_such/Type'; known types are"),
        refused("load what is loaded", "load", "arm_controller", "'arm_controller' was already loaded"),
        refused("configure unknown", "configure", "nope", "'nope' can not be configured: no controller"),
        refused("unload unknown", "unload", "nope", "'nope' can not be unloaded: no controller"),
        refused("clean up unknown", "cleanup", "nope", "'nope' can not be cleaned up: no controller"),
        refused("unload active", "unload", "arm_controller", "'arm_controller' can not be unloaded while it is active"),
        refused("configure active", "configure", "arm_controller", "can not be configured while it is active"),
        refused("clean up active", "cleanup", "arm_controller", "can not be cleaned up while it is active"),
    ],
)
def test_invalid_requests_are_refused(
    client: ManagerClient, stack: StackProcess, verb: str, name: str, expected: str
) -> None:
    assert client.set_from_text(MANAGER, "bad.type", "no_such/Type")
    before = stack.words.count(expected)
    assert not getattr(client, verb)(name)
    assert client.states() == AT_START
    assert stack.words.count(expected) == before + 1


@pytest.mark.row("golden-clean-unload", "cm-cleanup", "cm-unload", "cm-load")
def test_controller_is_cleaned_up_unloaded_and_loaded_again(client: ManagerClient) -> None:
    assert client.cleanup("conflict") and client.cleanup("conflict")
    assert client.states()["conflict"] == "unconfigured"
    assert client.unload("conflict")
    assert "conflict" not in client.states()
    client.spin_until(lambda: "conflict" not in client.node.get_node_names())
    assert client.load("conflict")
    assert client.states()["conflict"] == "unconfigured"
    client.spin_until(lambda: "conflict" in client.node.get_node_names())


@pytest.mark.row("golden-clean-unload", "cm-unload")
def test_inactive_controller_is_unloaded_without_cleanup(client: ManagerClient) -> None:
    assert client.states()["spare"] == "inactive"
    assert client.unload("spare")
    assert "spare" not in client.states()


@pytest.mark.row("cm-configure")
def test_only_an_inactive_controller_is_configured_again(client: ManagerClient) -> None:
    assert client.unload("spare")
    assert client.load("spare") and client.configure("spare")
    assert client.listed()["spare"].required_command_interfaces == ["joint6/position"]
    assert client.switch((), ["arm_controller"])[0] and client.switch(["spare"])[0]
    assert not client.configure("spare") and client.states()["spare"] == "active"
    assert client.switch((), ["spare"])[0] and client.configure("spare")
    assert client.states()["spare"] == "inactive"


@pytest.mark.row("cm-configure", "cm-switch-strict")
def test_unconfigured_controller_must_be_configured_before_activation(client: ManagerClient) -> None:
    assert client.switch((), ["hand_controller"])[0] and client.cleanup("hand_controller")
    text = "Controller with name 'hand_controller' can not be activated since it is unconfigured"
    ok, message = client.switch(["hand_controller"])
    assert not ok and message.startswith(text)
    assert client.states()["hand_controller"] == "unconfigured"
    assert client.configure("hand_controller") and client.states()["hand_controller"] == "inactive"
    assert client.switch(["hand_controller"])[0]


@pytest.mark.row("cm-configure", "cm-cleanup")
def test_action_exists_only_while_configured(client: ManagerClient) -> None:
    name = f"{client.namespace}/arm_controller/follow_joint_trajectory"

    def there() -> bool:
        return name in dict(get_action_names_and_types(client.node))

    def ends() -> list[tuple[str, str]]:
        topic = f"{name}/_action/feedback"
        found = client.node.get_publishers_info_by_topic(topic) + client.node.get_subscriptions_info_by_topic(topic)
        return [(end.node_name, end.endpoint_type.name) for end in found]

    assert client.switch((), ["arm_controller"])[0]
    client.spin_until(there)
    assert ends()
    assert client.cleanup("arm_controller")
    client.spin_until(lambda: not there(), instead=ends)
    assert client.configure("arm_controller") and client.configure("arm_controller")
    client.spin_until(there)
    assert client.switch(["arm_controller"])[0]
    client.spin_until(lambda: client.node.get_node_names().count("arm_controller") == 1)


@pytest.mark.row("cm-configure", "cm-cleanup")
def test_node_exists_from_load_to_unload_and_publishes_every_transition(client: ManagerClient) -> None:
    """A client that has discovered the node once can use it after every new configuration."""
    assert client.get("/hand_controller", "interface_name") == ["position"]
    with client.hearing(TransitionEvent, "/hand_controller/transition_event") as received:
        assert client.switch((), ["hand_controller"])[0] and client.cleanup("hand_controller")
        assert client.get("/hand_controller", "interface_name") == ["position"]
        assert client.configure("hand_controller") and client.configure("hand_controller")
        assert client.get("/hand_controller", "interface_name") == ["position"]
        assert client.switch(["hand_controller"])[0]
        client.spin_until(lambda: len(received) >= 12)
    begun = ["deactivate", "cleanup", "configure", "cleanup", "configure", "activate"]
    assert [m.transition.label for m in received[::2]] == begun
    assert {m.transition.label for m in received[1::2]} == {"transition_success"}
    client.spin_until(lambda: client.node.count_subscribers(f"{client.namespace}/hand_controller/commands") == 1)
    client.spin_until(lambda: client.node.get_node_names().count("hand_controller") == 1)


def test_subscriptions_exist_only_while_configured(client: ManagerClient) -> None:
    assert client.switch((), ["hand_controller"])[0]
    for _ in range(3):
        assert client.cleanup("hand_controller")
        client.spin_until(lambda: client.node.count_subscribers(f"{client.namespace}/hand_controller/commands") == 0)
        assert client.configure("hand_controller")
        client.spin_until(lambda: client.node.count_subscribers(f"{client.namespace}/hand_controller/commands") == 1)


def test_goal_that_ends_with_its_controller_receives_its_result(client: ManagerClient) -> None:
    arm = ArmClient("goal_client", client.namespace)
    result = arm.send(PICK, seconds=5)
    assert client.switch((), ["arm_controller"])[0]
    assert client.cleanup("arm_controller")
    answer: Any = arm.wait(result)
    assert answer.result.error_code == FollowJointTrajectory.Result.INVALID_GOAL
    assert answer.result.error_string == "Current goal cancelled during deactivate transition."
    arm.close()


@pytest.mark.row("cm-services")
def test_reload_controller_libraries_unloads_all_controllers_only_if_forced(client: ManagerClient) -> None:
    service = f"{MANAGER}/reload_controller_libraries"
    assert not client.call(ReloadControllerLibraries, service, force_kill=False).ok
    assert client.states() == AT_START
    assert client.call(ReloadControllerLibraries, service, force_kill=True).ok
    assert client.states() == {}


@pytest.mark.slow
def test_fifty_listing_clients_and_a_hundred_switches_are_served(client: ManagerClient, stack: StackProcess) -> None:
    # Every client receives all responses. A client with a queue of ten can lose its own response.
    all_of_them = QoSProfile(depth=1, history=HistoryPolicy.KEEP_ALL)

    def another(kind: Any, name: str) -> Any:
        return client.node.create_client(kind, f"{client.namespace}{MANAGER}/{name}", qos_profile=all_of_them)

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
