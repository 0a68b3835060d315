"""Test velocity commands through controller, manager, safety gate and mock hardware."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from controller.forward.commands import ForwardParameters
from controller.forward.rate_command_controller import RateCommandController
from controller.interface import limits_of
from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from hal.components.component_set import ComponentSet
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.types import FloatArray
from sim_backend.clock import SimulatedClock
from tests.controller.bench import ARM, ARM_LIMITS, PERIOD_S

LIMITS = dict.fromkeys(ARM, replace(ARM_LIMITS, lower=-100.0, upper=100.0))
"""Limits that are far away, because the safety gate brakes a joint before the end of its range."""


@dataclass
class Drive:
    """A drive with two joints that accept velocities."""

    parameters: dict[str, Any] = field(default_factory=dict)
    clock: SimulatedClock = field(default_factory=lambda: SimulatedClock(10.0))

    def __post_init__(self) -> None:
        interfaces = tuple(f"{joint}/velocity" for joint in ARM)
        hardware = MockHardware("mock", ARM, self.clock, calculate_dynamics=True, command_interfaces=interfaces)
        components = ComponentSet([hardware], self.clock)
        self.manager = ControllerManager(components, LIMITS)
        parameters = ForwardParameters(joints=ARM, interface_name="velocity", **self.parameters)
        self.controller = RateCommandController("test", "drive", parameters, limits_of(ARM, LIMITS))
        self.manager.registry.add(self.controller)
        self.loop = ControlLoop(components, self.manager, LIMITS, self.clock, PERIOD_S)
        hardware.configure()
        self.loop.activate()

    def cycle(self, count: int) -> FloatArray:
        """Run cycles and return the measured velocities, shape (cycles, 2)."""
        measured = []
        for _ in range(count):
            self.clock.sleep_until(self.clock.now() + PERIOD_S)
            measured.append(self.loop.step().velocity)
        return np.array(measured)


def steps(velocities: FloatArray) -> float:
    """Return the largest acceleration."""
    return float(np.abs(np.diff(velocities, axis=0)).max() / PERIOD_S)


def test_joints_follow_commands_and_stop_after_the_last_one() -> None:
    drive = Drive()
    assert drive.cycle(5).tolist() == [[0.0, 0.0]] * 5
    drive.controller.submit([0.5, -1.0])
    velocities = drive.cycle(40)
    assert velocities[5] == pytest.approx([0.5, -1.0])
    assert velocities[-1] == pytest.approx([0.0, 0.0])
    assert steps(velocities) <= ARM_LIMITS.acceleration + 1e-6


@pytest.mark.parametrize("strict", [False, True])
def test_a_message_of_the_wrong_length_deactivates_only_in_strict_mode(strict: bool) -> None:
    drive = Drive({"deactivate_on_wrong_length": strict, "command_timeout": 0.0})
    drive.controller.submit([0.5, -1.0])
    drive.cycle(5)
    drive.controller.submit([0.5])
    velocities = drive.cycle(40)
    state = LifecycleState.INACTIVE if strict else LifecycleState.ACTIVE
    assert drive.manager.registry.state("drive") is state
    assert velocities[-1] == pytest.approx([0.0, 0.0] if strict else [0.5, -1.0])
    assert steps(velocities) <= ARM_LIMITS.acceleration + 1e-6
