"""Test the lifecycles of controllers, their claims and the handling of failing controllers."""

import logging

import numpy as np
import pytest

from controller.manager.controller_spec import ControllerSpec
from controller.manager.manager import ControllerManager
from controller.manager.registry import Transition
from controller.manager.switch import SwitchRequest
from controller.manager_errors import ClaimError, ManagerError, SwitchError
from controller.parameters import Parameters
from hal.lifecycle import LifecycleState
from tests.controller.manager_bench import HELD, STANDING, Interfaces, Puppet, cycle, managing

UNCONFIGURED, INACTIVE, ACTIVE = LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE, LifecycleState.ACTIVE


def states(manager: ControllerManager) -> dict[str, LifecycleState]:
    return {name: entry.state for name, entry in manager.registry.loaded.items()}


# Lifecycles


def test_a_controller_can_be_loaded_and_unloaded() -> None:
    manager, puppet = managing(), Puppet("p", "a")
    manager.registry.load(ControllerSpec("p", puppet.kind, Parameters()))
    assert (manager.registry.state("p"), dict(manager.registry.controllers)) == (UNCONFIGURED, {})
    manager.registry.configure("p", puppet)
    assert (manager.registry.state("p"), dict(manager.registry.controllers)) == (INACTIVE, {"p": puppet})
    manager.registry.cleanup("p")
    assert (manager.registry.state("p"), dict(manager.registry.controllers)) == (UNCONFIGURED, {})
    manager.registry.cleanup("p")  # ros2_control accepts this state, too.
    manager.registry.unload("p")
    assert states(manager) == {}


def test_configuring_again_replaces_the_controller() -> None:
    first, second = Puppet("p", "a"), Puppet("p", "b")
    manager = managing(first)
    manager.registry.transitions.clear()
    manager.registry.configure("p", second)
    assert manager.registry.controllers["p"] is second
    assert list(manager.registry.transitions) == [
        Transition("p", INACTIVE, UNCONFIGURED),
        Transition("p", UNCONFIGURED, INACTIVE),
    ]


@pytest.mark.parametrize(
    ("what", "text"),
    [
        (
            lambda m: m.registry.load(ControllerSpec("p", "test", Parameters())),
            "A controller named 'p' was already loaded",
        ),
        (
            lambda m: m.registry.configure("p", Puppet("p", "b")),
            "'p' can not be configured while it is active: deactivate it",
        ),
        (lambda m: m.registry.cleanup("p"), "'p' can not be cleaned up while it is active: deactivate it"),
        (lambda m: m.registry.unload("p"), "'p' can not be unloaded while it is active: deactivate it"),
        (
            lambda m: m.registry.configure("nope", Puppet("nope", "b")),
            "'nope' can not be configured: no controller with this",
        ),
        (lambda m: m.registry.cleanup("nope"), "'nope' can not be cleaned up: no controller with this name exists"),
        (lambda m: m.registry.unload("nope"), "'nope' can not be unloaded: no controller with this name exists"),
    ],
    ids=["load twice", "configure active", "cleanup active", "unload active", "configure", "cleanup", "unload"],
)
def test_a_refused_request_changes_nothing(what, text: str) -> None:  # type: ignore[no-untyped-def]
    puppet = Puppet("p", "a")
    manager = managing(puppet, active=["p"])
    before = manager.registry.loaded
    with pytest.raises(ManagerError, match=text):
        what(manager)
    assert manager.registry.loaded is before and manager.registry.controllers["p"] is puppet


def test_an_interface_that_the_hardware_lacks_cannot_be_claimed() -> None:
    manager = managing()
    manager.registry.load(ControllerSpec("p", "test", Parameters()))
    with pytest.raises(
        ClaimError, match=r"p claims d/position, which the hardware does not have \(it has a/position, b/"
    ):
        manager.registry.configure("p", Puppet("p", "a", "d"))
    assert states(manager) == {"p": UNCONFIGURED}


def test_another_thread_reads_a_consistent_state() -> None:
    manager = managing(Puppet("p", "a"), Puppet("q", "b"))
    seen = manager.registry.loaded
    manager.switch(SwitchRequest(("p", "q")), HELD)
    manager.release({"b/position"}, "gone")
    assert [entry.state for entry in seen.values()] == [INACTIVE, INACTIVE]
    assert states(manager) == {"p": ACTIVE, "q": INACTIVE}


# The start


def test_the_first_controller_gets_the_joint_at_the_start_and_the_others_are_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    manager = ControllerManager(Interfaces(), {})
    for puppet in (Puppet("first", "a", "b"), Puppet("second", "b"), Puppet("third", "c"), Puppet("fourth")):
        manager.registry.add(puppet)
    manager.activate(STANDING, HELD)
    assert states(manager) == {"first": ACTIVE, "second": INACTIVE, "third": ACTIVE, "fourth": ACTIVE}
    assert (
        "second stays inactive: Unable to activate controller 'second' since the command interface 'b/pos"
        in caplog.text
    )


def test_no_controller_is_activated_before_the_first_measurement() -> None:
    manager = ControllerManager(Interfaces(), {})
    manager.registry.add(Puppet("p", "a"))
    with pytest.raises(SwitchError, match="Could not activate controller 'p': its joints have not been measured yet"):
        manager.switch(SwitchRequest(("p",)), HELD)
    assert states(manager) == {"p": INACTIVE}


def test_broken_and_fallback_controllers_stay_inactive_at_the_start(caplog: pytest.LogCaptureFixture) -> None:
    spare, broken, main = Puppet("spare", "a"), Puppet("broken", "b", failing=["activate"]), Puppet("main", "a")
    manager = ControllerManager(Interfaces(), {})
    for puppet in (spare, broken):
        manager.registry.add(puppet)
    manager.registry.load(ControllerSpec("main", "test", Parameters(), fallback=("spare",)))
    manager.registry.configure("main", main)
    manager.activate(STANDING, HELD)
    assert states(manager) == {"spare": INACTIVE, "broken": INACTIVE, "main": ACTIVE}
    assert "broken stays inactive: Could not activate controller 'broken': broken is broken" in caplog.text


# One cycle


def test_controllers_command_only_their_own_joints() -> None:
    manager = managing(Puppet("p", "c", wanted=0.7), Puppet("q", "a", wanted=-0.7), active=["p", "q"])
    last = HELD.copy()
    assert cycle(manager, last) == [-0.7, 0.2, 0.7]
    np.testing.assert_array_equal(last, HELD)


def test_a_controller_starts_at_the_last_command_and_commands_nothing_before() -> None:
    puppet = Puppet("p", "c", "b")
    manager = managing(puppet)
    assert cycle(manager) == HELD.tolist()
    manager.switch(SwitchRequest(("p",)), HELD)
    assert puppet.command.tolist() == [0.3, 0.2]
    assert cycle(manager) == [0.1, 0.7, 0.7]
    manager.switch(SwitchRequest((), ("p",)), HELD)
    assert cycle(manager) == HELD.tolist()


def test_an_active_controller_reports_whether_it_has_settled() -> None:
    manager = managing(Puppet("p", "a"))
    assert manager.cycle.settled("nobody")
    assert manager.cycle.settled("p")  # An inactive controller counts as settled.
    manager.switch(SwitchRequest(("p",)), HELD)
    assert not manager.cycle.settled("p")


@pytest.mark.parametrize("failing", [["update"], ["update", "deactivate"]])
def test_a_failing_controller_is_deactivated_and_the_others_continue(
    failing: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    broken, sound = Puppet("broken", "a", failing=failing), Puppet("sound", "b")
    manager = managing(broken, sound, active=["broken", "sound"])
    assert cycle(manager) == [0.1, 0.7, 0.3]
    assert states(manager) == {"broken": INACTIVE, "sound": ACTIVE}
    assert broken.calls == ["activate", "update", "deactivate"]
    assert "broken failed and is being deactivated: its joints are brought to rest" in caplog.messages
    assert cycle(manager) == [0.1, 0.7, 0.3]


def test_a_command_of_the_wrong_length_is_an_error(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Short(Puppet):
        def update(self, state, now_s: float, period_s: float) -> None:  # type: ignore[no-untyped-def]
            self.command = np.array([0.7])

    manager = managing(Short("short", "a", "b"), active=["short"])
    assert cycle(manager) == HELD.tolist()
    assert states(manager) == {"short": INACTIVE}
    assert "the command has shape (1,), expected (2,)" in caplog.text


def test_the_fallback_starts_in_the_next_cycle() -> None:
    broken, spare = Puppet("broken", "a", failing=["update"]), Puppet("spare", "a", wanted=0.5)
    manager = managing(broken, spare, active=["broken"], fallback={"broken": ("spare",)})
    assert cycle(manager) == HELD.tolist()
    assert spare.command.tolist() == [0.1]
    assert states(manager) == {"broken": INACTIVE, "spare": ACTIVE}
    assert cycle(manager) == [0.5, 0.2, 0.3]


def test_joints_hold_if_the_fallback_cannot_start(caplog: pytest.LogCaptureFixture) -> None:
    manager = managing(Puppet("p", "a", failing=["update"]), active=["p"], fallback={"p": ("gone",)})
    assert cycle(manager) == HELD.tolist()
    assert "the fallback of p cannot take over: Could not activate controller with name 'gone'" in caplog.text


# Lost hardware and shutdown


@pytest.mark.parametrize(
    ("interfaces", "with_states", "left"),
    [
        ({"a/position"}, False, {"q"}),
        ({"a/velocity"}, False, {"p", "q"}),
        ({"a/velocity"}, True, {"q"}),
        ({"a/position", "b/position"}, False, set()),
        (set(), True, {"p", "q"}),
    ],
)
def test_release_deactivates_the_controllers_of_lost_interfaces(
    interfaces: set[str], with_states: bool, left: set[str], caplog: pytest.LogCaptureFixture
) -> None:
    manager = managing(Puppet("p", "a"), Puppet("q", "b"), active=["p", "q"])
    manager.release(interfaces, "the bus is gone", with_states)
    assert {name for name, state in states(manager).items() if state is ACTIVE} == left
    assert ("p is being deactivated because it uses a/" in caplog.text and "the bus is gone" in caplog.text) == (
        "p" not in left
    )


def test_a_controller_that_cannot_be_deactivated_does_not_block_the_others() -> None:
    manager = managing(Puppet("stubborn", "a", failing=["deactivate"]), Puppet("q", "b"), active=["stubborn", "q"])
    with pytest.raises(RuntimeError, match="stubborn is broken"):
        manager.deactivate()
    assert states(manager) == {"stubborn": INACTIVE, "q": INACTIVE}


def test_no_controller_starts_on_unmeasured_joints() -> None:
    manager = managing(Puppet("p", "a"), Puppet("q", "b"))
    unknown = np.array([np.nan, 0.2, 0.3])
    with pytest.raises(SwitchError, match="'p': its joints have not been measured yet"):
        manager.switch(SwitchRequest(("p",)), unknown)
    manager.switch(SwitchRequest(("q",)), unknown)
    assert states(manager) == {"p": INACTIVE, "q": ACTIVE}


def test_every_transition_is_recorded(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    manager = managing(Puppet("p", "a", failing=["update"]), active=["p"])
    cycle(manager)
    assert [(t.start, t.goal) for t in manager.registry.transitions] == [
        (UNCONFIGURED, INACTIVE),
        (INACTIVE, ACTIVE),
        (ACTIVE, INACTIVE),
    ]
