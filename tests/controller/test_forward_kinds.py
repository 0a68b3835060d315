"""Test forward command controllers of positions, velocities and efforts, under all their ros2_control types."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controller.forward.commands import ForwardParameters
from controller.forward.forward_command_controller import (
    ForwardCommandController,
    JointGroupEffortController,
    JointGroupPositionController,
    JointGroupVelocityController,
)
from controller.forward.rate_command_controller import RateCommandController
from controller.interface import ControllerContext
from hal.robot_description.description import Description, HardwareInfo
from hal.types import JointLimits, JointState

PERIOD_S = 0.05
JOINTS = ("shoulder", "elbow")
LIMITS = JointLimits(-2.0, 2.0, velocity=4.0, acceleration=12.0, jerk=120.0, effort=3.0)
AT_ONCE = replace(LIMITS, acceleration=math.inf)
STANDING = JointState(0.0, np.zeros(2), np.zeros(2), np.zeros(2))
NAN, INF = float("nan"), float("inf")


def context(limits: JointLimits = LIMITS) -> ControllerContext:
    interfaces = dict.fromkeys(JOINTS, ("position", "velocity", "effort"))
    component = HardwareInfo("arm", "system", "mock", {}, interfaces, interfaces)
    return ControllerContext(Description("", {}), component, dict.fromkeys(JOINTS, limits), lambda name: True)


def rates(interface: str = "velocity", limits: JointLimits = AT_ONCE, **parameters: Any) -> RateCommandController:
    asked = ForwardParameters(joints=JOINTS, interface_name=interface, **parameters)  # type: ignore[arg-type]
    made = ForwardCommandController.build("rates", asked, context(limits))
    assert isinstance(made, RateCommandController)
    made.activate(STANDING, np.full(2, NAN))
    return made


def cycles(controller: RateCommandController, count: int) -> list[list[float]]:
    """Run cycles and return their commands."""
    commands = []
    for _ in range(count):
        controller.update(STANDING, 0.0, PERIOD_S)
        commands.append(controller.command.tolist())
    return commands


@pytest.mark.parametrize(
    ("kind", "interface"),
    [
        (JointGroupPositionController, "position"),
        (JointGroupVelocityController, "velocity"),
        (JointGroupEffortController, "effort"),
    ],
)
def test_group_controllers_have_a_fixed_interface(kind: type[ForwardCommandController], interface: str) -> None:
    parameters = kind.parameters_type.model_validate({"joints": JOINTS})
    assert isinstance(parameters, ForwardParameters)
    assert parameters.unused() == []
    made = kind.build("group", parameters, context())
    assert made.kind == f"{interface}_controllers/JointGroup{interface.capitalize()}Controller"
    assert made.command_interfaces == tuple(f"{joint}/{interface}" for joint in JOINTS) == parameters.claims()
    assert made.parameters is parameters


@pytest.mark.parametrize(
    "kind", [JointGroupPositionController, JointGroupVelocityController, JointGroupEffortController]
)
def test_a_group_controller_rejects_another_interface(kind: type[ForwardCommandController]) -> None:
    with pytest.raises(ValueError, match="interface_name"):
        kind.parameters_type.model_validate({"joints": JOINTS, "interface_name": "acceleration"})


@pytest.mark.parametrize("interface", ["position", "velocity", "effort"])
def test_the_forward_command_controller_supports_every_interface(interface: str) -> None:
    parameters = ForwardParameters.model_validate({"joints": JOINTS, "interface_name": interface})
    made = ForwardCommandController.build("plain", parameters, context())
    assert made.kind == "forward_command_controller/ForwardCommandController"
    assert made.command_interfaces == tuple(f"{joint}/{interface}" for joint in JOINTS)


def test_positions_have_no_timeout() -> None:
    parameters = ForwardParameters(joints=JOINTS, interface_name="position", command_timeout=1.0)
    assert parameters.unused() == ["command_timeout (positions have no timeout)"]
    assert ForwardParameters(joints=JOINTS, interface_name="velocity", command_timeout=1.0).unused() == []


@pytest.mark.parametrize("interface", ["velocity", "effort"])
def test_the_command_is_zero_until_the_first_message(interface: str) -> None:
    controller = rates(interface)
    assert cycles(controller, 2) == [[0.0, 0.0]] * 2
    assert controller.settled()
    assert controller.submit([1.0, -1.0]) is None
    assert not controller.settled()
    assert cycles(controller, 2) == [[1.0, -1.0]] * 2
    assert not controller.settled()


@pytest.mark.parametrize(("interface", "largest"), [("velocity", 4.0), ("effort", 3.0)])
def test_a_command_beyond_the_limits_goes_to_the_limit(
    interface: str, largest: float, caplog: pytest.LogCaptureFixture
) -> None:
    controller = rates(interface)
    controller.submit([9.0, -9.0])
    assert cycles(controller, 1) == [[largest, -largest]]
    assert "beyond the limits" in caplog.text


def test_velocities_change_no_faster_than_the_acceleration_limits() -> None:
    controller = rates(limits=LIMITS, command_timeout=0.0)
    controller.submit([4.0, -0.3])
    path = np.array([[0.0, 0.0], *cycles(controller, 10)])
    assert np.abs(np.diff(path, axis=0)).max() <= LIMITS.acceleration * PERIOD_S + 1e-9
    assert path[-1].tolist() == [4.0, -0.3]


def test_joints_that_still_move_at_activation_are_brought_to_rest() -> None:
    controller = rates(limits=LIMITS)
    controller.activate(STANDING, np.array([1.0, -0.7]))
    np.testing.assert_allclose(cycles(controller, 3), [[0.4, -0.1], [0.0, 0.0], [0.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize(
    ("timeout_s", "driven"),
    [(0.0, 40), (0.5, 11), (0.12, 3)],
    ids=["0: never, as in ros2_control", "default", "another"],
)
@pytest.mark.parametrize("interface", ["velocity", "effort"])
def test_a_command_that_is_not_repeated_becomes_zero(
    interface: str, timeout_s: float, driven: int, caplog: pytest.LogCaptureFixture
) -> None:
    controller = rates(interface, command_timeout=timeout_s)
    controller.submit([1.0, 1.0])
    path = cycles(controller, 40)
    assert path == [[1.0, 1.0]] * driven + [[0.0, 0.0]] * (40 - driven)
    assert caplog.text.count("no command for") == (driven < 40)
    assert controller.settled() == (driven < 40)


def test_the_default_timeout_is_half_a_second() -> None:
    controller = rates()
    for _ in range(6):
        controller.submit([1.0, 1.0])
        assert cycles(controller, 10) == [[1.0, 1.0]] * 10
    assert cycles(controller, 2) == [[1.0, 1.0], [0.0, 0.0]]


def test_the_timeout_can_be_set_while_the_controller_runs() -> None:
    controller = rates()
    controller.reconfigure(ForwardParameters(joints=JOINTS, interface_name="velocity", command_timeout=0.0))
    controller.submit([1.0, 1.0])
    assert cycles(controller, 40)[-1] == [1.0, 1.0]


def test_the_timeout_of_positions_cannot_be_set() -> None:
    parameters = ForwardParameters(joints=JOINTS, interface_name="position")
    made: Any = ForwardCommandController.build("plain", parameters, context())
    with pytest.raises(ValueError, match="command_timeout applies only to velocities and efforts"):
        made.reconfigure(parameters)


@pytest.mark.parametrize(
    ("kind", "settable"),
    [
        (ForwardCommandController, {"command_timeout"}),
        (JointGroupVelocityController, {"command_timeout"}),
        (JointGroupEffortController, {"command_timeout"}),
        (JointGroupPositionController, set()),
    ],
)
def test_only_the_timeout_can_be_set(kind: type[ForwardCommandController], settable: set[str]) -> None:
    assert kind.settable == settable


def test_deactivation_resets_the_command_to_zero() -> None:
    controller = rates()
    controller.submit([1.0, 1.0])
    cycles(controller, 1)
    controller.submit([2.0, 2.0])
    controller.deactivate()
    assert controller.command.tolist() == [0.0, 0.0]
    controller.submit([3.0, 3.0])  # The controller is inactive.
    controller.activate(STANDING, np.full(2, NAN))
    assert cycles(controller, 1) == [[0.0, 0.0]]


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (
            [1.0],
            "command size (1) does not match number of interfaces (2): the command is dropped. "
            "Send one value for each of shoulder, elbow",
        ),
        ([1.0, NAN], "Non-finite value received. Dropping message"),
        ([-INF, 1.0], "Non-finite value received. Dropping message"),
        ([], None),
    ],
)
def test_an_invalid_command_is_dropped_and_does_not_extend_the_last_one(
    values: list[float], reason: str | None
) -> None:
    controller = rates(command_timeout=0.12)
    controller.submit([1.0, 1.0])
    cycles(controller, 2)
    assert controller.submit(values) == reason
    assert cycles(controller, 2) == [[1.0, 1.0], [0.0, 0.0]]


@pytest.mark.parametrize("interface", ["position", "velocity", "effort"])
def test_a_setting_restores_ros2_controls_reaction_to_a_wrong_length(interface: str) -> None:
    parameters = ForwardParameters.model_validate(
        {"joints": JOINTS, "interface_name": interface, "deactivate_on_wrong_length": True}
    )
    made: Any = ForwardCommandController.build("strict", parameters, context())
    made.activate(STANDING, np.zeros(2))
    assert "Send one value for each" in made.submit([1.0])
    with pytest.raises(ValueError, match=r"command size \(1\) does not match number of interfaces \(2\)"):
        made.update(STANDING, 0.0, PERIOD_S)
