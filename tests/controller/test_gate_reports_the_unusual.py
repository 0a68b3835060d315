"""Test that controllers themselves stay within the velocity limits, so that the safety gate logs only unusual
commands."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from controller.gripper.goal import GripperGoal, GripperParameters
from controller.gripper.gripper_action_controller import GripperActionController
from controller.interface import Controller
from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from hal.components.component_set import ComponentSet
from hal.types import FloatArray
from sim_backend.clock import SimulatedClock
from tests.controller.bench import (
    ARM_LIMITS,
    HAND,
    HAND_LIMITS,
    JOINTS,
    LIMITS,
    PERIOD_S,
    Bench,
    ScriptedHardware,
    arm_parameters,
    to,
)

STALL_S = 0.13


@pytest.fixture
def gate_lines(caplog: pytest.LogCaptureFixture) -> Iterator[Callable[[], list[str]]]:
    caplog.set_level("INFO")
    yield lambda: [text for text in caplog.messages if text.startswith("safety gate")]


def largest_steps(bench: Bench) -> FloatArray:
    steps: FloatArray = np.abs(np.diff(bench.path(), axis=0)).max(axis=0)
    return steps


def test_a_hand_command_is_a_ramp_at_the_velocity_limit(gate_lines: Callable[[], list[str]]) -> None:
    bench = Bench().up()
    bench.cycle()
    for position in (0.05, 0.0):
        bench.hand.submit([position])
        bench.cycle(15)
        assert bench.hand.command.tolist() == [position]
    assert largest_steps(bench)[2] == pytest.approx(HAND_LIMITS.velocity * PERIOD_S)
    assert gate_lines() == []


@pytest.mark.parametrize("method", ["ruckig", "splines", "none"])
def test_the_gate_does_not_change_a_fast_trajectory_in_a_late_cycle(
    method: str, gate_lines: Callable[[], list[str]]
) -> None:
    bench = Bench(arm_parameters(interpolation_method=method)).up()
    bench.cycle()
    handle = bench.send(to(1.5, -1.5, after_s=0.5))
    for _ in range(30):
        bench.clock.sleep_until(bench.clock.now() + STALL_S)
        bench.cycle(2)
    assert handle.done
    assert bench.arm.command.tolist() == pytest.approx([1.5, -1.5])
    assert (largest_steps(bench)[:2] <= ARM_LIMITS.velocity * PERIOD_S + 1e-9).all()
    assert gate_lines() == []


def test_the_gate_does_not_change_a_gripper_goal_in_a_late_cycle(gate_lines: Callable[[], list[str]]) -> None:
    clock = SimulatedClock(10.0)
    components = ComponentSet([ScriptedHardware(clock)], clock)
    manager = ControllerManager(components, LIMITS)
    gripper = GripperActionController("gripper", GripperParameters(joint=HAND), HAND_LIMITS, JOINTS.index(HAND))
    manager.registry.add(gripper)
    loop = ControlLoop(components, manager, LIMITS, clock, PERIOD_S)
    components.components[0].hardware.configure()
    loop.activate()
    handle = gripper.submit(GripperGoal(0.05))
    for _ in range(14):
        clock.sleep_until(clock.now() + STALL_S)
        loop.step()
    assert handle.done and gripper.command[0] == pytest.approx(0.05)
    assert gate_lines() == []


def test_a_controller_that_leaps_is_reported(gate_lines: Callable[[], list[str]]) -> None:
    class Leaping:
        """Controller that ignores the velocity limits."""

        def __init__(self, wrapped: Controller) -> None:
            self._wrapped = wrapped

        def __getattr__(self, name: str) -> object:
            return getattr(self._wrapped, name)

        @property
        def command(self) -> FloatArray:
            return np.full(len(self._wrapped.command), 0.04)

    bench = Bench(wrap=lambda controller: Leaping(controller) if controller.name == "hand" else controller).up()  # type: ignore[arg-type,return-value]
    bench.cycle(3)
    assert gate_lines() == ["safety gate: finger: command 0.0400 is too far for one cycle: limited to 0.0050"]


def test_a_hand_that_starts_outside_its_limits_is_reported(gate_lines: Callable[[], list[str]]) -> None:
    bench = Bench()
    bench.hardware._position = np.array([0.0, 0.0, 0.051])
    bench.up().cycle(20)
    (line,) = gate_lines()
    assert "outside the limits" in line and "returning slowly" in line
    assert bench.loop.command[2] == HAND_LIMITS.upper
