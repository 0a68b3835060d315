"""Test that a joint far outside its limits is rejected, and that a joint slightly outside its limits returns slowly."""

import logging
from collections.abc import Callable

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from controller.manager.switch import SwitchRequest
from controller.shutdown import shut_down
from drivers.servos import sts
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.gate import RETURN_SHARE
from hal.hal_errors import ActivationError
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.types import FloatArray, JointCommand, JointLimits, JointState
from servoloop.simulation.stack import SimulatedStack
from sim_backend.clock import SimulatedClock
from tests.controller.bench import ARM_LIMITS, Bench, to

PERIOD_S = 0.02
LIMITS = JointLimits(-1.0, 1.0, 2.0, 8.0, 80.0)
SLOW_STEP = RETURN_SHARE * LIMITS.velocity * PERIOD_S


class Recorded(MockHardware):
    """Mock hardware that starts at given positions, like a user's class, and records every command."""

    def __init__(self, clock: SimulatedClock, position: float, *, kind: str = "position") -> None:
        super().__init__("own", ("joint1",), clock, True, (f"joint1/{kind}",))
        self._position[:] = position
        self.written: list[float] = []

    def write(self, command: JointCommand) -> None:
        self.written.append(float(command.values[0]))
        super().write(command)


def loop_over(hardware: MockHardware, clock: SimulatedClock) -> ControlLoop:
    components = ComponentSet([hardware], clock)
    loop = ControlLoop(
        components, ControllerManager(components, {"joint1": LIMITS}), {"joint1": LIMITS}, clock, PERIOD_S
    )
    configure_all(components)
    return loop


def cycles(loop: ControlLoop, clock: SimulatedClock, count: int) -> None:
    for _ in range(count):
        clock.sleep_until(clock.now() + PERIOD_S)
        loop.step()


@pytest.mark.parametrize("kind", ["position", "velocity"])
@pytest.mark.parametrize("position", [2.5, -1.11])
def test_a_joint_far_outside_its_limits_is_rejected_with_the_values(position: float, kind: str) -> None:
    clock = SimulatedClock(10.0)
    hardware = Recorded(clock, position, kind=kind)
    loop = loop_over(hardware, clock)
    with pytest.raises(ActivationError, match=rf"joint1 is at {position:.4f}, outside its limits -1.0000 to 1.0000"):
        loop.activate()
    assert hardware.state is LifecycleState.INACTIVE and not hardware.written


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_slightly_outside_its_limits_returns_slowly_and_is_logged_once(
    side: float, caplog: pytest.LogCaptureFixture
) -> None:
    clock = SimulatedClock(10.0)
    hardware = Recorded(clock, side * 1.02)
    loop = loop_over(hardware, clock)
    with caplog.at_level(logging.INFO, "servoloop"):
        loop.activate()
        cycles(loop, clock, 12)
    steps = np.abs(np.diff([side * 1.02, *hardware.written]))
    assert steps.max() <= SLOW_STEP + 1e-12
    assert hardware.written[-1] == side * LIMITS.upper
    assert sum("returning slowly" in message for message in caplog.messages) == 1


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_goal_waits_until_its_joint_has_returned(side: float) -> None:
    """A reference that moved on in the meantime would make the joint jump at its limit."""
    bench = Bench()
    bench.hardware.place("shoulder", side * 2.15)
    handle = bench.up().send(to(0.0, 0.0))
    bench.cycle(60)
    assert handle.status is GoalStatus.SUCCEEDED
    velocity = np.diff(bench.path()[:, 0]) / bench.loop.period_s
    changes = np.abs(np.diff(velocity)) / bench.loop.period_s
    assert changes.max() <= ARM_LIMITS.acceleration + 1e-9


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_switch_of_controllers_does_not_end_the_return(side: float) -> None:
    bench = Bench()
    bench.hardware.place("shoulder", side * 2.15)
    bench.up().cycle(2)
    bench.manager.switch(SwitchRequest(("arm",), ("arm",)), bench.loop.within_limits)
    handle = bench.send(to(0.0, 0.0))
    bench.cycle(60)
    assert handle.status is GoalStatus.SUCCEEDED
    velocity = np.diff(bench.path()[:, 0]) / bench.loop.period_s
    changes = np.abs(np.diff(velocity)) / bench.loop.period_s
    assert changes.max() <= ARM_LIMITS.acceleration + 1e-9


def test_an_arm_is_parked_after_its_joint_has_returned() -> None:
    bench = Bench()
    bench.hardware.place("shoulder", 2.15)
    assert shut_down(bench.up().loop, True, {"shoulder": -0.5}, 0.5) == []
    velocity = np.diff(bench.path()[:, 0]) / bench.loop.period_s
    changes = np.abs(np.diff(velocity)) / bench.loop.period_s
    assert changes.max() <= ARM_LIMITS.acceleration + 1e-9
    assert bench.path()[-1, 0] == pytest.approx(-0.5)


def test_the_arm_in_mujoco_returns_slowly() -> None:
    stack = SimulatedStack(wire=False)
    joint = stack.arm.joints[0]
    limits = stack.files.limits[joint]
    begin = stack.world.position()
    begin[stack.world.joints.index(joint)] = limits.upper + 0.04 * (limits.upper - limits.lower)
    stack = SimulatedStack(wire=False, start=begin.tolist())
    commands: list[FloatArray] = []

    def keep(state: JointState) -> None:
        commands.append(stack.loop.command.copy())

    stack.on_state = keep
    stack.up()
    first = stack.loop.command.copy()
    stack.run(0.5)
    steps = np.abs(np.diff([first, *commands], axis=0))[:, 0]
    assert first[0] > limits.upper
    assert 0.0 < steps.max() <= RETURN_SHARE * limits.velocity * stack.loop.period_s + 1e-12


class Deceived(MockHardware):
    """Mock hardware that returns one false reading, which is selected by its number."""

    def __init__(self, clock: SimulatedClock, lies: Callable[[int], float]) -> None:
        super().__init__("own", ("joint1",), clock, True)
        self.readings, self._lies = 0, lies

    def read(self) -> JointState:
        state = super().read()
        false = state.position + self._lies(self.readings)
        self.readings += 1
        return JointState(state.stamp_s, false, state.velocity, state.effort)


@pytest.mark.parametrize("number", range(6))
def test_a_single_false_reading_is_not_used_as_the_start(number: int) -> None:
    clock = SimulatedClock(10.0)
    hardware = Deceived(clock, lambda reading: 0.9 if reading == number else 0.0)
    loop = loop_over(hardware, clock)
    loop.activate()
    assert loop.command.tolist() == [0.0]


def test_the_torque_stays_off_if_readings_never_agree() -> None:
    clock = SimulatedClock(10.0)
    hardware = Deceived(clock, lambda reading: 0.9 * (reading % 2))
    loop = loop_over(hardware, clock)
    with pytest.raises(ActivationError, match=r"two readings of joint1 differ \(0.9000, then 0.0000|0.0000, then 0.9"):
        loop.activate()
    assert hardware.state is LifecycleState.INACTIVE


def test_a_failed_activation_disables_only_the_torque_that_it_enabled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Torque that an earlier program has enabled stays on and holds the arm."""
    stack = SimulatedStack()
    configure_all(stack.loop.hardware)
    left, limp = stack.bus.servos[1], stack.bus.servos[2]
    left.memory.put(sts.goal_position, left.memory.get(sts.present_position))
    left.memory.put(sts.torque_enable, 1)

    def refuse(*_: object) -> None:
        raise ActivationError("not now")

    monkeypatch.setattr(ControlLoop, "take_over", refuse)
    with pytest.raises(ActivationError, match="not now"):
        stack.loop.activate()
    assert left.memory.get(sts.torque_enable) == 1 and limp.memory.get(sts.torque_enable) == 0
    assert stack.hardware.state is LifecycleState.INACTIVE
