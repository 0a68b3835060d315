"""The mock does what GenericSystem does: the state is the command."""

import numpy as np
import pytest

from hal.mock_hardware import MockHardware
from hal.types import JointCommand
from sim_backend.clock import SimulatedClock
from tests.hal.bench import at


def active(calculate_dynamics: bool = False) -> MockHardware:
    hardware = MockHardware("arm", ["a", "b"], SimulatedClock(3.0), calculate_dynamics)
    hardware.configure()
    hardware.activate()
    return hardware


def test_it_begins_at_zero() -> None:
    state = active().read()
    np.testing.assert_array_equal(state.position, [0.0, 0.0])
    np.testing.assert_array_equal(state.velocity, [0.0, 0.0])
    assert np.isnan(state.effort).all()
    assert state.stamp_s == 3.0


def test_it_is_at_once_where_it_is_told_to_be() -> None:
    hardware = active()
    hardware.write(JointCommand(at(1.0, -2.0), 0.05))
    np.testing.assert_array_equal(hardware.read().position, [1.0, -2.0])
    np.testing.assert_array_equal(hardware.read().velocity, [0.0, 0.0])


@pytest.mark.parametrize("period_s", [0.05, 0.01])
def test_with_dynamics_the_velocity_is_the_difference_quotient(period_s: float) -> None:
    hardware = active(calculate_dynamics=True)
    hardware.write(JointCommand(at(1.0, 0.0), period_s))
    hardware.write(JointCommand(at(1.1, -0.2), period_s))
    np.testing.assert_allclose(hardware.read().velocity, [0.1 / period_s, -0.2 / period_s])
    hardware.write(JointCommand(at(1.1, -0.2), period_s))
    np.testing.assert_array_equal(hardware.read().velocity, [0.0, 0.0])


def test_a_state_is_the_readers_own() -> None:
    hardware = active()
    hardware.read().position[:] = 9.0
    np.testing.assert_array_equal(hardware.read().position, [0.0, 0.0])


def test_it_stays_where_it_was_through_a_deactivation() -> None:
    hardware = active()
    hardware.write(JointCommand(at(1.0, -2.0), 0.05))
    assert hardware.deactivate(relax=True) == []
    hardware.activate()
    np.testing.assert_array_equal(hardware.read().position, [1.0, -2.0])
