"""Test that a switch is executed completely or not at all."""

import logging

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.manager.manager import ControllerManager
from controller.manager.switch import NOTHING, Strictness, SwitchRequest, taken
from controller.manager_errors import SwitchError
from hal.lifecycle import LifecycleState
from tests.controller.manager_bench import HELD, Interfaces, Puppet, cycle, managing

BEST, STRICT, AUTO, FORCE = Strictness.BEST_EFFORT, Strictness.STRICT, Strictness.AUTO, Strictness.FORCE_AUTO
UNKNOWN = "Could not activate controller with name 'nope' because no controller with this name exists"


def four(hardware: Interfaces | None = None) -> ControllerManager:
    """Return a manager: arm is active on a and b, rival uses b, hand uses c, and the controller raw is unconfigured."""
    puppets = Puppet("arm", "a", "b"), Puppet("rival", "b"), Puppet("hand", "c"), Puppet("raw")
    manager = managing(*puppets, active=["arm"], hardware=hardware)
    manager.registry.cleanup("raw")
    return manager


def active(manager: ControllerManager) -> set[str]:
    return {name for name, entry in manager.registry.loaded.items() if entry.active}


DONE = "Successfully switched controllers!"
CLAIMED = (
    "Unable to activate controller 'rival' since the command interface 'b/position' is currently claimed "
    "by another controller."
)
RAW = "Controller with name 'raw' can not be activated since it is unconfigured, not inactive: configure it first."

ANSWERED = [
    (["hand"], [], BEST, f"{DONE}\nActivated controllers: [ hand ]", {"arm", "hand"}),
    (["hand"], [], STRICT, f"{DONE}\nActivated controllers: [ hand ]", {"arm", "hand"}),
    (["hand", "hand"], [], STRICT, f"{DONE}\nActivated controllers: [ hand ]", {"arm", "hand"}),
    ([], ["arm"], STRICT, f"{DONE}\nDeactivated controllers: [ arm ]", set()),
    (
        ["rival"],
        ["arm"],
        STRICT,
        f"{DONE}\nDeactivated controllers: [ arm ]\nActivated controllers: [ rival ]",
        {"rival"},
    ),
    (["arm"], ["arm"], STRICT, f"{DONE}\nDeactivated controllers: [ arm ]\nActivated controllers: [ arm ]", {"arm"}),
    (["arm"], [], BEST, NOTHING, {"arm"}),
    ([], ["hand"], BEST, NOTHING, {"arm"}),
    ([], [], STRICT, NOTHING, {"arm"}),
    (["nope", "hand"], [], BEST, f"{DONE}\nActivated controllers: [ hand ]", {"arm", "hand"}),
    (["raw", "hand"], ["nope"], BEST, f"{DONE}\nActivated controllers: [ hand ]", {"arm", "hand"}),
    (["arm", "hand"], [], AUTO, f"{DONE}\nActivated controllers: [ hand ]", {"arm", "hand"}),
    (["rival"], [], FORCE, f"{DONE}\nDeactivated controllers: [ arm ]\nActivated controllers: [ rival ]", {"rival"}),
]
REFUSED = [
    (["arm"], [], STRICT, "Controller with name 'arm' is already active."),
    (["arm", "hand"], [], STRICT, "Controller with name 'arm' is already active."),
    ([], ["hand"], STRICT, "Controller with name 'hand' can not be deactivated since it is not active."),
    (["nope"], [], BEST, UNKNOWN),
    (["nope"], [], STRICT, UNKNOWN),
    (["nope", "hand"], [], STRICT, UNKNOWN),
    ([], ["nope"], BEST, UNKNOWN.replace("activate", "deactivate")),
    (["raw"], [], STRICT, RAW),
    (["nope", "raw"], [], STRICT, f"{UNKNOWN}\n{RAW}"),
    (["rival"], [], STRICT, CLAIMED),
    (["rival"], [], BEST, CLAIMED),
    (["rival"], [], AUTO, CLAIMED),
]


@pytest.mark.parametrize(("start", "stop", "strictness", "text", "then"), ANSWERED)
def test_a_switch_changes_the_expected_controllers(
    start: list[str], stop: list[str], strictness: Strictness, text: str, then: set[str]
) -> None:
    manager = four()
    assert manager.switch(SwitchRequest(tuple(start), tuple(stop), strictness), HELD) == text
    assert active(manager) == then


@pytest.mark.parametrize(("start", "stop", "strictness", "text"), REFUSED)
def test_a_refused_switch_changes_nothing(start: list[str], stop: list[str], strictness: Strictness, text: str) -> None:
    manager = four()
    before = manager.registry.loaded
    with pytest.raises(SwitchError) as refusal:
        manager.switch(SwitchRequest(tuple(start), tuple(stop), strictness), HELD)
    assert str(refusal.value) == text
    assert manager.registry.loaded is before


def test_two_controllers_activated_together_cannot_share_a_joint() -> None:
    manager = managing(Puppet("arm", "a", "b"), Puppet("rival", "b"))
    with pytest.raises(SwitchError, match="'rival' since the command interface 'b/position' is currently claimed"):
        manager.switch(SwitchRequest(("arm", "rival"), strictness=FORCE), HELD)
    assert active(manager) == set()


@pytest.mark.parametrize(("lost", "kind"), [("c/position", "command"), ("c/velocity", "state")])
@pytest.mark.parametrize("strictness", list(Strictness))
def test_an_unavailable_interface_prevents_a_switch(lost: str, kind: str, strictness: Strictness) -> None:
    manager = four(Interfaces(lost=lost))
    with pytest.raises(
        SwitchError, match=f"controller 'hand' since the {kind} interface '{lost}' is not available: is its"
    ):
        manager.switch(SwitchRequest(("hand",), ("arm",), strictness), HELD)
    assert active(manager) == {"arm"}


# Undo


def test_a_failed_activation_undoes_the_switch(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    old, fine, broken = Puppet("old", "a"), Puppet("fine", "b"), Puppet("broken", "c", "a", failing=["activate"])
    manager = managing(old, fine, broken, active=["old"])
    with pytest.raises(SwitchError) as refusal:
        manager.switch(SwitchRequest(("fine", "broken"), ("old",), STRICT), HELD)
    assert str(refusal.value) == "Could not activate controller 'broken': broken is broken. Nothing was switched."
    assert active(manager) == {"old"}
    assert fine.calls == ["activate", "deactivate"]
    assert broken.calls == ["activate", "deactivate"]  # The failed activation is undone.
    assert cycle(manager) == [0.7, 0.2, 0.3]


def test_an_incomplete_undo_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    old, broken = Puppet("old", "a"), Puppet("broken", "a", failing=["activate"])
    manager = managing(old, broken, active=["old"])
    old.failing.add("activate")
    with pytest.raises(SwitchError) as refusal:
        manager.switch(SwitchRequest(("broken",), ("old",), STRICT), HELD)
    assert str(refusal.value) == (
        "Could not activate controller 'broken': broken is broken; "
        "and Could not activate controller 'old': old is broken: "
        "the controller stays inactive and its joints hold position"
    )
    assert active(manager) == set()
    assert cycle(manager) == HELD.tolist()


def test_an_undo_continues_after_a_controller_that_cannot_be_reactivated(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    old, worn, fine = Puppet("old", "a"), Puppet("worn", "b"), Puppet("fine", "c")
    broken = Puppet("broken", "a", "b", failing=["activate"])
    manager = managing(old, worn, fine, broken, active=["old", "worn", "fine"])
    for puppet in (old, worn):
        puppet.failing.add("activate")
    with pytest.raises(SwitchError) as refusal:
        manager.switch(SwitchRequest(("broken",), ("old", "worn", "fine"), STRICT), HELD)
    assert active(manager) == {"fine"}
    assert all(f"'{puppet.name}': {puppet.name} is broken: the con" in str(refusal.value) for puppet in (old, worn))


NAMES = ["arm", "rival", "hand", "raw", "broken", "nope"]
SOME = st.lists(st.sampled_from(NAMES), max_size=4).map(tuple)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.builds(SwitchRequest, SOME, SOME, st.sampled_from(Strictness)), max_size=6))
def test_no_sequence_of_switches_gives_a_joint_two_controllers(
    wishes: list[SwitchRequest],
) -> None:
    manager = four()
    manager.registry.add(Puppet("broken", "a", "c", failing=["activate"]))
    for request in wishes:
        before = active(manager)
        try:
            manager.switch(request, HELD)
        except SwitchError:
            assert active(manager) == before
        claims = [claim for name in active(manager) for claim in manager.registry.loaded[name].commands]
        assert len(claims) == len(set(claims)) == len(taken(manager.registry.loaded))
        assert manager.registry.loaded["raw"].state is LifecycleState.UNCONFIGURED
        assert "broken" not in active(manager)
