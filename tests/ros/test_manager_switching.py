"""Switch controllers over ROS, with the messages of ros2_control. Invalid requests do not change anything."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros.manager_bench import AT_START, DONE, restore
from tests.ros.manager_client import AUTO, BEST_EFFORT, FORCE_AUTO, STRICT, ManagerClient
from tests.ros.stack_process import StackProcess

NAMESPACES = ["", pytest.param("/lab/left", marks=pytest.mark.slow)]
pytestmark = pytest.mark.parametrize("namespace", NAMESPACES, scope="module")

NOTHING = "After checking the controllers, no controllers need to be activated or deactivated."
NOPE = "Could not activate controller with name 'nope' because no controller with this name exists"
GONE = "Could not deactivate controller with name 'gone' because no controller with this name exists"
ALREADY = "Controller with name 'arm_controller' is already active."
CONFLICT = (
    "Unable to activate controller 'conflict' since the command interface 'joint1/position' is currently claimed "
    "by another controller."
)
NOT_CONFIGURED = (
    "Controller with name 'spare' can not be activated since it is unconfigured, not inactive: configure it first."
)
UNAVAILABLE = "Unable to activate controller '{}' since the {} interface '{}' is not available"
EVERY_STRICTNESS = (0, BEST_EFFORT, STRICT, AUTO, FORCE_AUTO)


@pytest.fixture
def client(connected: ManagerClient) -> Iterator[ManagerClient]:
    """Restore the initial state of the stack."""
    yield connected
    connected.set_hardware("active")
    restore(connected)


@pytest.mark.row("cm-switch-claims")
def test_first_controller_of_the_file_has_the_joint_at_the_start(client: ManagerClient, stack: StackProcess) -> None:
    assert client.states() == AT_START
    assert f"conflict stays inactive: {CONFLICT}" in stack.words


def row(case: str, *values: Any, rows: tuple[str, ...] = ()) -> Any:
    return pytest.param(*values, id=case, marks=[pytest.mark.row(*rows)] if rows else [])


BOTH = ("golden-already-active",)
CLAIMED = ("golden-claimed", "cm-switch-claims")


@pytest.mark.parametrize(
    ("activate", "deactivate", "strictness", "ok", "text"),
    [
        row("active, strict", ["arm_controller"], [], STRICT, False, ALREADY, rows=(*BOTH, "cm-switch-strict")),
        row("active, best effort", ["arm_controller"], [], BEST_EFFORT, True, NOTHING, rows=BOTH),
        row("active, nothing said", ["arm_controller"], [], 0, True, NOTHING, rows=("cm-switch-default",)),
        row("unknown, strict", ["nope"], [], STRICT, False, NOPE, rows=("golden-unknown-only",)),
        row(
            "unknown, best effort",
            ["nope"],
            [],
            BEST_EFFORT,
            False,
            NOPE,
            rows=("golden-unknown-only", "cm-switch-best-effort"),
        ),
        row("unknown, nothing said", ["nope"], [], 0, False, NOPE, rows=("cm-switch-default",)),
        row("unknown to stop", [], ["gone"], STRICT, False, GONE, rows=("cm-switch-strict",)),
        row("unknown both", ["nope"], ["gone"], BEST_EFFORT, False, f"{GONE}\n{NOPE}", rows=("cm-switch-best-effort",)),
        row("a claim taken, strict", ["conflict"], [], STRICT, False, CONFLICT, rows=CLAIMED),
        row("a claim taken, best effort", ["conflict"], [], BEST_EFFORT, False, CONFLICT, rows=CLAIMED),
        row("nobody", [], [], STRICT, True, NOTHING),
        row("no such strictness", ["arm_controller"], [], 9, False, "9 is not a valid Strictness"),
    ],
)
def test_switch_without_changes_is_answered(
    client: ManagerClient, activate: list[str], deactivate: list[str], strictness: int, ok: bool, text: str
) -> None:
    assert client.switch(activate, deactivate, strictness) == (ok, text)
    assert client.states() == AT_START


@pytest.mark.row("golden-unknown-and-known", "cm-switch-strict", "cm-switch-best-effort", "cm-switch-success")
def test_switch_of_unknown_and_known_controllers(client: ManagerClient) -> None:
    assert client.switch((), ["arm_controller"]) == (True, f"{DONE}\nDeactivated controllers: [ arm_controller ]")
    assert client.switch(["nope", "arm_controller"], (), STRICT) == (False, NOPE)
    assert client.states()["arm_controller"] == "inactive"
    started = (True, f"{DONE}\nActivated controllers: [ arm_controller ]")
    assert client.switch(["nope", "arm_controller"], (), BEST_EFFORT) == started
    assert client.states() == AT_START


@pytest.mark.row("cm-switch-strict", "cm-switch-best-effort")
@pytest.mark.parametrize(
    ("bad", "text"),
    [("nope", NOPE), ("arm_controller", ALREADY), ("spare", NOT_CONFIGURED)],
    ids=["unknown", "active already", "unconfigured"],
)
def test_switch_with_one_invalid_name(client: ManagerClient, bad: str, text: str) -> None:
    assert client.switch((), ["hand_controller"])[0] and client.cleanup("spare")
    before = client.states()
    # The valid controllers of both lists keep their states, including the controller to deactivate.
    assert client.switch([bad, "hand_controller"], ["joint_state_broadcaster"], STRICT) == (False, text)
    assert client.states() == before
    done = f"{DONE}\nDeactivated controllers: [ joint_state_broadcaster ]\nActivated controllers: [ hand_controller ]"
    assert client.switch([bad, "hand_controller"], ["joint_state_broadcaster"], BEST_EFFORT) == (True, done)
    assert client.states() == {**before, "hand_controller": "active", "joint_state_broadcaster": "inactive"}


@pytest.mark.row("cm-switch-strict", "cm-switch-best-effort")
def test_deactivation_of_an_inactive_controller(client: ManagerClient) -> None:
    text = "Controller with name 'spare' can not be deactivated since it is not active."
    assert client.switch((), ["spare", "hand_controller"], STRICT) == (False, text)
    assert client.states() == AT_START
    assert client.switch((), ["spare", "hand_controller"], BEST_EFFORT)[0]
    assert client.states() == {**AT_START, "hand_controller": "inactive"}


@pytest.mark.row("cm-switch-default")
def test_unset_strictness_means_best_effort(client: ManagerClient, stack: StackProcess) -> None:
    stopped = (True, f"{DONE}\nDeactivated controllers: [ hand_controller ]")
    assert client.switch(["nope"], ["hand_controller"], 0) == stopped
    assert client.switch(["nope", "hand_controller", "arm_controller"], (), 0)[0]
    assert client.states() == AT_START
    assert "strictness is not set: using BEST_EFFORT (1)" in stack.words


@pytest.mark.row("cm-switch-claims")
def test_taken_claim_fails_the_whole_switch(client: ManagerClient) -> None:
    assert client.switch((), ["hand_controller"])[0]
    for strictness in (0, BEST_EFFORT, STRICT, AUTO):
        assert client.switch(["hand_controller", "conflict"], (), strictness) == (False, CONFLICT)
        assert client.states() == {**AT_START, "hand_controller": "inactive"}


@pytest.mark.row("cm-switch-success")
def test_one_switch_exchanges_two_controllers(client: ManagerClient) -> None:
    text = f"{DONE}\nDeactivated controllers: [ arm_controller ]\nActivated controllers: [ conflict spare ]"
    assert client.switch(["conflict", "spare"], ["arm_controller"]) == (True, text)
    assert client.listed()["conflict"].claimed_interfaces == ["joint1/position"]
    text = f"{DONE}\nDeactivated controllers: [ conflict spare ]\nActivated controllers: [ arm_controller ]"
    assert client.switch(["arm_controller"], (), FORCE_AUTO) == (True, text)
    assert client.states() == AT_START


@pytest.mark.row("cm-switch-claims")
@pytest.mark.parametrize("label", ["inactive", "unconfigured"])
def test_inactive_hardware_fails_commanding_controllers_with_any_strictness(client: ManagerClient, label: str) -> None:
    client.set_hardware(label)
    before = client.states()
    assert (before["arm_controller"], before["joint_state_broadcaster"]) == ("inactive", "active")
    for strictness in EVERY_STRICTNESS:
        ok, text = client.switch(["arm_controller"], (), strictness)
        assert not ok and text.startswith(UNAVAILABLE.format("arm_controller", "command", "joint1/position"))
        ok, text = client.switch(["hand_controller"], ["joint_state_broadcaster"], strictness)
        assert not ok and text.startswith(UNAVAILABLE.format("hand_controller", "command", "hand_right_joint/position"))
        assert client.states() == before


def test_broadcaster_can_be_activated_on_inactive_hardware(client: ManagerClient) -> None:
    client.set_hardware("inactive")
    assert client.switch((), ["joint_state_broadcaster"])[0] and client.switch(["joint_state_broadcaster"])[0]
    client.set_hardware("active")
    assert client.switch(["arm_controller"])[0]
