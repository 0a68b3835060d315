"""Loss of one of several buses, and its effect on the joints of the other buses, in simulated time."""

from pathlib import Path

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.shutdown import shut_down
from drivers.driver_errors import PortLost
from hal.lifecycle import LifecycleState
from hal.types import FloatArray
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
from sim_backend.buses.port import VirtualPort
from tests.ros.two_components import ARM, write_servos
from tests.stack.rig import CLOSED_M, PICK, READY

ACTIVE, UNCONFIGURED = LifecycleState.ACTIVE, LifecycleState.UNCONFIGURED


def one_component() -> SimulatedStack:
    """Return a stack with two buses in one component."""
    return SimulatedStack(files=read_files(robot=CONFIG / "robot_arm_two_buses.yaml"))


def two_components(folder: Path, keep_alive: bool = False) -> SimulatedStack:
    """Return a stack with two components, each with a bus of its own."""
    return SimulatedStack(files=read_files(write_servos(folder)), keep_alive=keep_alive)


def sent(rig: SimulatedStack) -> list[FloatArray]:
    """Record all commands of the loop from now on."""
    commands: list[FloatArray] = [rig.loop.previous_command, rig.loop.command]
    write = rig.loop.hardware.write

    def note(values: FloatArray, period_s: float) -> None:
        commands.append(values)
        write(values, period_s)

    rig.loop.hardware.write = note  # type: ignore[method-assign]
    return commands


def gentle(rig: SimulatedStack, path: list[FloatArray]) -> bool:
    """Return whether all joints of the arm were braked within their limits."""
    velocity = np.diff(np.array(path)[:, :6], axis=0) / rig.loop.period_s
    limit = rig.loop.limits[0].acceleration * rig.loop.period_s * 1.2
    return bool(np.abs(np.diff(velocity, axis=0)).max() <= limit)


@pytest.mark.parametrize("relax", [False, True])
def test_arm_is_braked_and_parked_before_release_when_the_hand_bus_is_lost(relax: bool) -> None:
    rig = one_component().up()
    rig.go(PICK)
    rig.run(0.9)
    rig.ports["hand"].port.unplug()
    with pytest.raises(PortLost):
        rig.run(0.5)
    commands, packets = sent(rig), len(rig.ports["arm"].sent)
    assert np.abs(commands[1] - commands[0]).max() > 0.05, "it is moving"
    problems = shut_down(rig.loop, relax, dict.fromkeys(ARM, 0.0), 0.25)
    assert all("bus hand" in problem for problem in problems)
    assert len(commands) > 8
    assert len(rig.ports["arm"].sent) - packets >= len(commands) - 2, "each of them went to the arm"
    assert gentle(rig, commands)
    arm = rig.world.position()[:6]
    np.testing.assert_allclose(arm, 0.0 if relax else commands[-1][:6], atol=0.05)


def test_lost_hand_does_not_abort_the_arm_goal(tmp_path: Path) -> None:
    rig = two_components(tmp_path).up()
    handle = rig.go(PICK)
    assert rig.hand.submit([CLOSED_M]) is None
    rig.run(0.5)
    rig.ports["hand"].port.unplug()
    rig.run(3.0)
    assert handle.status is GoalStatus.SUCCEEDED
    np.testing.assert_allclose(rig.world.position()[:6], PICK, atol=0.05)
    assert [hardware.state for hardware in rig.made] == [ACTIVE, UNCONFIGURED]
    assert rig.manager.registry.state("hand_controller") is LifecycleState.INACTIVE


def test_lost_arm_aborts_its_goal_with_a_message(tmp_path: Path) -> None:
    rig = two_components(tmp_path).up()
    handle = rig.go(PICK)
    rig.run(0.9)
    rig.ports["arm"].port.unplug()
    rig.run(0.2)
    assert handle.status is GoalStatus.ABORTED
    assert rig.manager.registry.state("hand_controller") is ACTIVE
    assert rig.hand.submit([CLOSED_M]) is None
    rig.run(1.5)
    assert rig.loop.command[6] == pytest.approx(CLOSED_M)


def test_reactivated_arm_starts_at_its_measured_position(tmp_path: Path) -> None:
    """On reactivation, the goals of the servos equal the measured positions, and a new goal starts there."""
    rig = two_components(tmp_path, keep_alive=True).up()
    rig.go(PICK)
    rig.run(0.9)
    rig.ports["arm"].port.unplug()
    rig.run(1.0)
    rig.ports["arm"].port = VirtualPort(rig.lines["arm"], rig.clock, name="plugged in again")
    before = rig.world.position()[:6].copy()
    change = rig.loop.component_transitions.ask("arm", ACTIVE)
    rig.run(0.5)
    assert change.done and change.result() is None
    np.testing.assert_allclose(rig.world.position()[:6], before, atol=0.06)  # it sags a little
    rig.manager.activate(rig.loop.hardware.read(), rig.loop.command)
    commands = sent(rig)
    handle = rig.go(READY)
    rig.run(3.0)
    assert handle.status is GoalStatus.SUCCEEDED
    assert gentle(rig, commands)
