"""Tests of a component set: its life cycle and its cycles, also if one component fails."""

from collections.abc import Sequence

import numpy as np
import pytest

from drivers.driver_errors import PortMissing
from hal.components.component_lifecycle import activate_all, clean_up_all, configure_all, deactivate_all
from hal.components.component_set import ComponentSet
from hal.hal_errors import ActivationError
from hal.lifecycle import LifecycleState
from hal.types import JointCommand, JointState
from sim_backend.clock import SimulatedClock
from tests.hal.failing_mock import FailingMock
from tests.hal.faults import fault_texts

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = LifecycleState
NAMES = ("first", "second", "third")


class Failing(FailingMock):
    """Mock hardware that also records its commands and the way in which it was deactivated."""

    def __init__(self, name: str, clock: SimulatedClock, commands: Sequence[str] | None = None) -> None:
        super().__init__(name, (f"{name}_joint",), clock, command_interfaces=commands)
        self.relaxed: list[bool] = []
        self.written: list[JointCommand] = []

    def deactivate(self, relax: bool) -> Sequence[str]:
        self.call("deactivate")
        self.relaxed.append(relax)
        super().deactivate(relax)
        return [f"{self.name}: one servo does not respond"]

    def write(self, command: JointCommand) -> None:
        self.written.append(command)


def three(cycles_per_update: Sequence[int] | None = None) -> tuple[ComponentSet, list[Failing]]:
    clock = SimulatedClock(1.0)
    made = [Failing(name, clock) for name in NAMES]
    return ComponentSet(made, clock, cycles_per_update), made


def states(components: ComponentSet) -> list[LifecycleState]:
    return [component.state for component in components.components]


def test_the_state_of_the_set_is_the_furthest_state() -> None:
    components, made = three()
    assert components.state is UNCONFIGURED
    made[1].configure()
    assert components.state is INACTIVE
    made[1].activate()
    assert components.state is ACTIVE
    assert components.name == "first, second, third"


def test_a_failed_configuration_cleans_up_the_other_components() -> None:
    components, made = three()
    made[1].failing["configure"] = PortMissing("plug it in")
    with pytest.raises(PortMissing, match="plug it in"):
        configure_all(components)
    assert states(components) == [UNCONFIGURED] * 3


def test_a_failed_activation_is_undone_for_the_other_components() -> None:
    components, made = three()
    configure_all(components)
    made[2].failing["activate"] = ActivationError("move it by hand")
    with pytest.raises(ActivationError, match="move it by hand"):
        activate_all(components)
    assert states(components) == [INACTIVE] * 3
    assert [one.relaxed for one in made] == [[True], [True], []]


def test_an_error_in_a_cleanup_does_not_hide_why_the_configuration_failed(caplog: pytest.LogCaptureFixture) -> None:
    components, made = three()
    made[0].failing["cleanup"] = PortMissing("the port is gone")
    made[1].failing["configure"] = PortMissing("plug it in")
    with pytest.raises(PortMissing, match="plug it in"):
        configure_all(components)
    assert states(components) == [UNCONFIGURED] * 3
    assert caplog.messages == ["first could not be cleaned up: the port is gone"]


@pytest.mark.parametrize("lost", [0, 1])
def test_an_error_while_an_activation_is_undone_does_not_hide_why_it_failed(
    lost: int, caplog: pytest.LogCaptureFixture
) -> None:
    components, made = three()
    configure_all(components)
    made[lost].failing["deactivate"] = PortMissing("the port is gone")
    made[2].failing["activate"] = ActivationError("move it by hand")
    with pytest.raises(ActivationError, match="move it by hand"):
        activate_all(components)
    assert states(components) == [ACTIVE if place == lost else INACTIVE for place in range(3)]
    assert f"torque may still be on: could not switch {NAMES[lost]} off: the port is gone" in caplog.messages


def test_excluded_components_stay_as_they_are() -> None:
    components, _ = three()
    configure_all(components, ["first"])
    activate_all(components, ["second"])
    assert states(components) == [UNCONFIGURED, INACTIVE, ACTIVE]


def test_with_keep_alive_the_other_components_continue(caplog: pytest.LogCaptureFixture) -> None:
    components, made = three()
    made[0].failing["configure"] = PortMissing("plug it in")
    made[1].failing["activate"] = ActivationError("move it by hand")
    configure_all(components, keep_alive=True)
    activate_all(components, keep_alive=True)
    assert states(components) == [UNCONFIGURED, INACTIVE, ACTIVE]
    assert "first stays unconfigured: plug it in" in caplog.text
    assert "second stays inactive: move it by hand" in caplog.text


def test_keep_alive_does_not_hide_unexpected_errors() -> None:
    components, made = three()
    made[1].failing["configure"] = RuntimeError("a defect")
    with pytest.raises(RuntimeError, match="a defect"):
        configure_all(components, keep_alive=True)
    assert states(components) == [UNCONFIGURED] * 3


def test_all_components_are_switched_off_and_cleaned_up_although_one_fails() -> None:
    components, made = three()
    configure_all(components)
    activate_all(components)
    made[0].failing = {"deactivate": RuntimeError("a defect"), "cleanup": RuntimeError("another")}
    assert deactivate_all(components, relax=False) == [
        "could not switch first off: a defect",
        "second: one servo does not respond",
        "third: one servo does not respond",
    ]
    with pytest.raises(RuntimeError, match="another"):
        clean_up_all(components)
    assert states(components) == [UNCONFIGURED] * 3


def test_a_component_without_measurement_gets_no_command() -> None:
    components, made = three()
    configure_all(components)
    activate_all(components)
    components.read()
    components.write(np.array([0.1, np.nan, 0.3]), 0.05)
    assert [len(one.written) for one in made] == [1, 0, 1]


@pytest.mark.parametrize("state", [None, JointState(1.0, np.zeros(2), np.zeros(1), np.zeros(1))])
def test_a_state_of_the_wrong_size_loses_only_its_component(state: JointState | None) -> None:
    components, made = three()
    configure_all(components)
    made[1].read = lambda: state  # type: ignore[assignment, method-assign, return-value]
    np.testing.assert_array_equal(components.read().position, [0.0, np.nan, 0.0])
    assert components.lost == [components.components[1]]


def test_a_component_without_commands_is_only_read() -> None:
    clock = SimulatedClock(1.0)
    probe, arm = Failing("probe", clock, ()), Failing("arm", clock)
    components = ComponentSet([probe, arm], clock)
    configure_all(components)
    activate_all(components)
    state = components.read()
    components.write(np.array([0.1]), 0.05)
    assert (len(state.position), len(probe.written), len(arm.written)) == (2, 0, 1)


def test_a_component_with_only_outputs_is_written() -> None:
    clock = SimulatedClock(1.0)
    lamp, arm = Failing("lamp", clock, ()), Failing("arm", clock)
    lamp.outputs = ("lamp/led",)
    components = ComponentSet([lamp, arm], clock, cycles_per_update=(2, 1))
    configure_all(components)
    activate_all(components)
    for _ in range(4):
        components.read()
        components.write(np.array([np.nan]), 0.05)
    assert [len(one.written) for one in (lamp, arm)] == [2, 0]
    assert (lamp.written[-1].values.shape, lamp.written[-1].period_s) == ((0,), pytest.approx(0.1))


def test_a_slow_component_gets_commands_for_its_whole_period() -> None:
    components, made = three(cycles_per_update=(1, 1, 3))
    configure_all(components)
    activate_all(components)
    for _ in range(6):
        components.read()
        components.write(np.zeros(3), 0.05)
    assert [len(one.written) for one in made] == [6, 6, 2]
    assert [one.written[-1].period_s for one in made] == pytest.approx([0.05, 0.05, 0.15])
    components.update_every_cycle()
    for _ in range(6):
        components.read()
        components.write(np.zeros(3), 0.05)
    assert [len(one.written) for one in made] == [12, 12, 8]


def test_all_states_are_unknown_before_the_first_read() -> None:
    components, _ = three()
    configure_all(components, ["second", "third"])
    state = components.read()
    np.testing.assert_array_equal(state.position, [0.0, np.nan, np.nan])
    assert fault_texts(state) == {"second_joint": "second is unconfigured", "third_joint": "third is unconfigured"}
