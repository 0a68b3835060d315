"""One cycle after the other, the gate in between, and what late cycles do."""

import logging
from collections.abc import Callable

import numpy as np
import pytest

from controller.loop import ControlLoop
from controller.manager import ControllerManager
from controller.parameters import Parameters
from hal.errors import ActivationError
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState
from sim_backend.clock import SimulatedClock
from tests.controller.bench import JOINTS, LIMITS, PERIOD_S, Bench, ScriptedHardware, to

NAN = float("nan")


class Puppet:
    """A controller of all joints that wants whatever the test says."""

    name = "puppet"
    kind = "test"
    parameters = Parameters()
    command_interfaces = tuple(f"{joint}/position" for joint in JOINTS)
    state_interfaces = command_interfaces

    def __init__(self) -> None:
        self.command: FloatArray = np.zeros(3)
        self.during_update: Callable[[], None] = lambda: None

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.command = command.copy()

    def deactivate(self) -> None: ...

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self.during_update()

    def settled(self) -> bool:
        return True


def puppet_loop() -> tuple[Puppet, ControlLoop, ScriptedHardware, SimulatedClock]:
    clock = SimulatedClock(100.0)
    hardware = ScriptedHardware(clock)
    manager = ControllerManager(JOINTS)
    puppet = Puppet()
    manager.add(puppet)
    loop = ControlLoop(hardware, manager, LIMITS, clock, PERIOD_S)
    hardware.configure()
    loop.activate()
    return puppet, loop, hardware, clock


@pytest.mark.parametrize(
    ("wanted", "sent"),
    [
        ((0.1, -0.1, 0.001), (0.1, -0.1, 0.001)),
        ((NAN, 0.1, 0.0), (0.0, 0.1, 0.0)),
        ((float("inf"), -float("inf"), 0.0), (0.0, 0.0, 0.0)),
        ((1.0, -1.0, 0.05), (0.2, -0.2, 0.005)),
        ((1e12, -1e12, -1.0), (0.2, -0.2, 0.0)),
    ],
    ids=["fine", "NaN", "inf", "too far", "way off"],
)
def test_between_controllers_and_hardware_is_the_gate(wanted: tuple[float, ...], sent: tuple[float, ...]) -> None:
    puppet, loop, hardware, _ = puppet_loop()
    puppet.command = np.array(wanted)
    loop.step()
    np.testing.assert_allclose(hardware.written[-1], sent)
    np.testing.assert_allclose(loop.command, sent)


def test_the_gate_speaks_once_an_episode(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    puppet, loop, _, _ = puppet_loop()
    for command in (NAN, NAN, 0.0, NAN):
        puppet.command = np.array([command, 0.0, 0.0])
        loop.step()
    assert caplog.text.count("safety gate: shoulder: the command is nan: holding") == 2


def test_cycles_come_at_the_rate() -> None:
    _, loop, hardware, _ = puppet_loop()
    times: list[float] = []
    loop.on_cycle = lambda state: times.append(state.stamp_s)
    loop.run(lambda: len(times) == 5)
    np.testing.assert_allclose(times, 100.0 + PERIOD_S * np.arange(5))
    assert len(hardware.written) == 5
    assert (loop.figures.cycles, loop.figures.missed, loop.figures.latest_wake_up_s) == (5, 0, 0.0)


@pytest.mark.parametrize(
    ("stall_s", "then_at", "missed"),
    [
        (0.02, [0.05, 0.10, 0.15], 0),
        (0.07, [0.10, 0.15, 0.20], 1),
        (0.12, [0.15, 0.20, 0.25], 2),
        (1.01, [1.05, 1.10, 1.15], 20),
    ],
)
def test_missed_cycles_are_counted_and_not_made_up_for_in_a_burst(
    stall_s: float, then_at: list[float], missed: int
) -> None:
    """The first cycle takes ``stall_s``; what was due meanwhile is gone."""
    puppet, loop, _, clock = puppet_loop()
    times: list[float] = []

    def stall_once() -> None:
        if not times:
            clock.sleep_until(clock.now() + stall_s)

    puppet.during_update = stall_once
    loop.on_cycle = lambda state: times.append(state.stamp_s)
    loop.run(lambda: len(times) == 4)
    np.testing.assert_allclose(np.array(times) - 100.0, [0.0, *then_at])
    assert loop.figures.missed == missed
    assert loop.figures.longest_cycle_s == pytest.approx(stall_s)


def test_a_late_wake_up_is_in_the_figures() -> None:
    _, loop, _, clock = puppet_loop()
    sleep = clock.sleep_until
    clock.sleep_until = lambda deadline_s: sleep(deadline_s + 0.01)  # type: ignore[method-assign]
    loop.run(lambda: loop.figures.cycles == 3)
    assert loop.figures.latest_wake_up_s == pytest.approx(0.01)
    assert loop.figures.missed == 0


@pytest.mark.parametrize("where", ["read", "write", "controller"])
def test_an_exception_comes_out_of_the_loop_and_nothing_was_written_behind_it(where: str) -> None:
    puppet, loop, hardware, _ = puppet_loop()
    loop.step()
    error = RuntimeError("broken")

    def fail() -> None:
        raise error

    if where == "controller":
        puppet.during_update = fail
    else:
        hardware.failing[where] = error
    with pytest.raises(RuntimeError, match="broken"):
        loop.run(lambda: False)
    assert len(hardware.written) == 1


def test_inactive_hardware_is_read_and_not_written() -> None:
    _, loop, hardware, _ = puppet_loop()
    hardware.state = LifecycleState.INACTIVE
    loop.step()
    assert hardware.written == []
    assert hardware.calls[-1] == "read"


def test_it_starts_where_the_arm_stands_drawn_within_the_limits() -> None:
    bench = Bench()
    bench.hardware._position = np.array([0.3, 2.1, -0.001])
    bench.up()
    np.testing.assert_allclose(bench.loop.command, [0.3, 2.0, 0.0])
    bench.cycle()
    np.testing.assert_allclose(bench.path()[-1], [0.3, 2.0, 0.0])


def test_it_does_not_start_blind() -> None:
    """A joint that was never measured has no place to start from: let go again and say which."""
    bench = Bench()
    bench.hardware._position = np.array([0.3, NAN, 0.0])
    bench.hardware.configure()
    with pytest.raises(ActivationError, match="elbow has not been measured"):
        bench.loop.activate()
    assert bench.hardware.calls[-1] == "relax"
    assert bench.hardware.state is LifecycleState.INACTIVE


def test_a_goal_survives_the_gate_unchanged() -> None:
    """The controller stays within the limits by itself; the gate is for bugs."""
    bench = Bench().up()
    handle = bench.send(to(1.9, -1.9, after_s=0.0))
    while not handle.done:
        bench.cycle()
        assert bench.loop.command[:2] == pytest.approx(bench.arm.command, abs=1e-9)
