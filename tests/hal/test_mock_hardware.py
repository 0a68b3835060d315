"""Tests that the mock behaves like GenericSystem: each state equals the last command."""

import numpy as np
import pytest

from hal.mock_hardware import MockHardware
from hal.robot_description.description import parse_urdf
from hal.types import JointCommand
from sim_backend.clock import SimulatedClock
from tests.hal.bench import at


def active(calculate_dynamics: bool = False) -> MockHardware:
    hardware = MockHardware("arm", ["a", "b"], SimulatedClock(3.0), calculate_dynamics)
    hardware.configure()
    hardware.activate()
    return hardware


def test_all_states_begin_at_zero() -> None:
    state = active().read()
    np.testing.assert_array_equal(state.position, [0.0, 0.0])
    np.testing.assert_array_equal(state.velocity, [0.0, 0.0])
    assert np.isnan(state.effort).all()
    assert state.stamp_s == 3.0


def test_a_command_is_reached_immediately() -> None:
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


URDF = """
<robot name="r">
  <joint name="a" type="revolute"><parent link="0"/><child link="1"/><limit lower="-1" upper="1" velocity="1"/></joint>
  <joint name="b" type="continuous"><parent link="1"/><child link="2"/><limit velocity="4"/></joint>
  <joint name="c" type="continuous"><parent link="2"/><child link="3"/></joint>
  <ros2_control name="m" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin>{}</hardware>
    <joint name="a">
      <command_interface name="position"/><command_interface name="effort"/>
      <state_interface name="position"><param name="initial_value">0.5</param></state_interface>
      <state_interface name="effort"/><state_interface name="torque_offset"/>
    </joint>
    <joint name="b">
      <command_interface name="velocity"/>
      <state_interface name="position"/><state_interface name="velocity"/>
      <state_interface name="heat"><param name="initial_value">21</param></state_interface>
    </joint>
    <joint name="c"><state_interface name="position"><param name="initial_value">3</param></state_interface></joint>
  </ros2_control>
</robot>"""


def declared(*parameters: str) -> MockHardware:
    parameter_elements = "".join(f'<param name="{name}">true</param>' for name in parameters)
    hardware = MockHardware.of(parse_urdf(URDF.format(parameter_elements)).components[0], SimulatedClock(3.0))
    hardware.configure()
    hardware.activate()
    return hardware


def test_declared_interfaces_and_initial_values() -> None:
    hardware = declared()
    assert hardware.joints == ("a", "b", "c")
    assert hardware.command_interfaces == ("a/position", "a/effort", "b/velocity")
    state = hardware.read()
    np.testing.assert_array_equal(state.position, [0.5, 0.0, 3.0])
    assert state.extra["b/heat"] == 21.0
    assert np.isnan(state.extra["a/torque_offset"])
    assert np.isnan(state.effort).all()


def test_each_command_is_copied_to_its_state() -> None:
    hardware = declared()
    hardware.write(JointCommand(np.array([0.25, 3.0, 0.75]), 0.1))
    state = hardware.read()
    np.testing.assert_array_equal(state.position, [0.25, 0.0, 3.0])
    np.testing.assert_array_equal(state.velocity, [0.0, 0.75, 0.0])
    np.testing.assert_array_equal(state.effort, [3.0, np.nan, np.nan])


def test_with_dynamics_a_velocity_moves_the_joint() -> None:
    hardware = declared("calculate_dynamics")
    for _ in range(3):
        hardware.write(JointCommand(np.array([0.5, 0.0, 0.75]), 0.1))
    state = hardware.read()
    np.testing.assert_allclose(state.position, [0.5, 0.225, 3.0])
    np.testing.assert_allclose(state.velocity, [0.0, 0.75, 0.0])


def test_disabled_commands_freeze_the_state() -> None:
    hardware = declared("disable_commands")
    hardware.write(JointCommand(np.array([0.25, 3.0, 0.75]), 0.1))
    np.testing.assert_array_equal(hardware.read().position, [0.5, 0.0, 3.0])
    np.testing.assert_array_equal(hardware.read().velocity, [0.0, 0.0, 0.0])


def test_a_state_is_a_copy() -> None:
    hardware = active()
    hardware.read().position[:] = 9.0
    np.testing.assert_array_equal(hardware.read().position, [0.0, 0.0])


def test_deactivation_keeps_the_position() -> None:
    hardware = active()
    hardware.write(JointCommand(at(1.0, -2.0), 0.05))
    assert hardware.deactivate(relax=True) == []
    hardware.activate()
    np.testing.assert_array_equal(hardware.read().position, [1.0, -2.0])
