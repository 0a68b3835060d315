"""One of several lines is lost: what becomes of the joints on the others. Virtual servos on simulated time."""

from pathlib import Path

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.shutdown import shut_down
from drivers.errors import PortLost
from hal.lifecycle import LifecycleState
from hal.types import FloatArray
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import CONFIG, read_files
from sim_backend.buses.port import VirtualPort
from tests.ros.two_components import ARM, write_servos
from tests.stack.rig import CLOSED_M, PICK, READY

ACTIVE, UNCONFIGURED = LifecycleState.ACTIVE, LifecycleState.UNCONFIGURED


def one_component() -> SimulatedStack:
    """Two lines, one component."""
    return SimulatedStack(files=read_files(robot=CONFIG / "robot_arm_two_buses.yaml"))


def two_components(folder: Path, keep_alive: bool = False) -> SimulatedStack:
    """A line each."""
    return SimulatedStack(files=read_files(write_servos(folder)), keep_alive=keep_alive)


def sent(rig: SimulatedStack) -> list[FloatArray]:
    """Every command from here on, as it leaves the loop."""
    commands: list[FloatArray] = [rig.loop.previous_command, rig.loop.command]
    write = rig.loop.hardware.write

    def note(values: FloatArray, period_s: float) -> None:
        commands.append(values)
        write(values, period_s)

    rig.loop.hardware.write = note  # type: ignore[method-assign]
    return commands


def gentle(rig: SimulatedStack, path: list[FloatArray]) -> bool:
    """Whether no joint of the arm was braked harder than it may be."""
    velocity = np.diff(np.array(path)[:, :6], axis=0) / rig.loop.period_s
    limit = rig.loop.limits[0].acceleration * rig.loop.period_s * 1.2
    return bool(np.abs(np.diff(velocity, axis=0)).max() <= limit)


@pytest.mark.parametrize("relax", [False, True])
def test_with_the_hands_line_lost_the_arm_is_braked_and_parked_before_it_is_let_go(relax: bool) -> None:
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


def test_a_lost_hand_leaves_the_arm_its_goal(tmp_path: Path) -> None:
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


def test_a_lost_arm_ends_its_goal_in_words(tmp_path: Path) -> None:
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


def test_the_arm_comes_back_where_it_stands_and_goes_on_from_there(tmp_path: Path) -> None:
    """Activated again, it gets its torque with the goal at its place, and a new goal begins there."""
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
