"""Test the loop: its cycles, the safety gate, late cycles and lost hardware."""

import logging
from collections.abc import Callable

import numpy as np
import pytest

from controller import loop as loop_module
from controller.loop import ControlLoop
from controller.loop_figures import LoopFigures
from controller.manager.manager import ControllerManager
from controller.manager.switch import SwitchRequest
from controller.parameters import Parameters
from drivers.driver_errors import PortLost
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.fault_timeout import FAULT_CYCLES
from hal.hal_errors import ActivationError
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.types import FloatArray, JointFault, JointLimits, JointState
from sim_backend.clock import SimulatedClock
from tests.controller.bench import ARM_LIMITS, JOINTS, LIMITS, PERIOD_S, Bench, ScriptedHardware, to

NAN = float("nan")


class Puppet:
    """Controller that commands the values of a test to all joints."""

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

    def deactivate(self, reason: str = "") -> None: ...

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self.during_update()

    def settled(self) -> bool:
        return True


def puppet_loop(read_s: float = 0.0) -> tuple[Puppet, ControlLoop, ScriptedHardware, SimulatedClock]:
    clock = SimulatedClock(100.0)
    hardware = ScriptedHardware(clock)
    hardware.read_s = read_s
    components = ComponentSet([hardware], clock)
    manager = ControllerManager(components, LIMITS)
    puppet = Puppet()
    manager.registry.add(puppet)
    loop = ControlLoop(components, manager, LIMITS, clock, PERIOD_S)
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
def test_commands_pass_the_safety_gate(wanted: tuple[float, ...], sent: tuple[float, ...]) -> None:
    puppet, loop, hardware, _ = puppet_loop()
    puppet.command = np.array(wanted)
    loop.step()
    np.testing.assert_allclose(hardware.written[-1], sent)
    np.testing.assert_allclose(loop.command, sent)


def test_the_gate_logs_once_per_episode(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    puppet, loop, _, _ = puppet_loop()
    for command in (NAN, NAN, 0.0, NAN):
        puppet.command = np.array([command, 0.0, 0.0])
        loop.step()
    assert caplog.messages.count("safety gate: shoulder: the command is nan: holding") == 2


def test_joints_stopped_for_the_same_reason_share_a_log_line(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    puppet, loop, _, _ = puppet_loop()
    puppet.command = np.array([NAN, NAN, 0.0])
    loop.step()
    assert [line for line in caplog.messages if line.startswith("safety gate:")] == [
        "safety gate: shoulder, elbow: the command is nan: holding"
    ]


def test_cycles_run_at_the_rate() -> None:
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
def test_missed_cycles_are_counted_and_not_run_in_a_burst(stall_s: float, then_at: list[float], missed: int) -> None:
    """The first cycle takes ``stall_s``. Cycles that were due in this time are skipped."""
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


def test_a_measurement_may_take_the_time_that_other_steps_leave() -> None:
    """The other steps get the time that they took recently plus a tenth of the period, but at most half of the
    period."""
    puppet, loop, hardware, clock = puppet_loop()
    hardware.deadlines.clear()
    busy_s = iter([0.0, 0.02, 0.0, 0.04, 0.0])
    puppet.during_update = lambda: clock.sleep_until(clock.now() + next(busy_s))
    begins_s: list[float] = []
    for _ in range(5):
        begins_s.append(clock.now())
        loop.step()
    left_s = [0.045, 0.045, 0.025, 0.045 - 0.95 * 0.02, 0.025]
    np.testing.assert_allclose(np.array(hardware.deadlines) - begins_s, left_s)


def test_a_measurement_gets_the_time_of_its_fastest_predecessor_even_if_the_cycle_is_then_late() -> None:
    """Without this time, a loop whose rate is too high for its bus would never measure its joints."""
    puppet, loop, hardware, clock = puppet_loop(read_s=0.03)
    hardware.deadlines.clear()
    puppet.during_update = lambda: clock.sleep_until(clock.now() + 0.03)
    begins_s: list[float] = []
    for read_s, silent in ((0.04, ()), (0.02, JOINTS[:1]), (0.02, ()), (0.02, ())):
        hardware.read_s, hardware.faults = read_s, dict.fromkeys(silent, JointFault("silent", "servo 1: silent"))
        begins_s.append(clock.now())
        loop.step()
    left_s = np.array(hardware.deadlines) - begins_s
    np.testing.assert_allclose(left_s, [0.045, 1.25 * 0.03, 1.25 * 0.03, 0.025])


@pytest.mark.parametrize(("late_s", "left_s"), [(0.0, 0.045), (0.01, 0.035), (0.04, 0.02), (0.2, 0.02)])
def test_a_measurement_in_a_late_cycle_gets_at_least_half_a_period(late_s: float, left_s: float) -> None:
    """Of this half period, a tenth of a period is reserved for the other steps."""
    _, loop, hardware, clock = puppet_loop()
    hardware.deadlines.clear()
    sleep = clock.sleep_until
    clock.sleep_until = lambda deadline_s: sleep(deadline_s + late_s)  # type: ignore[method-assign]
    loop.run(lambda: loop.figures.cycles == 1)
    np.testing.assert_allclose(np.array(hardware.deadlines), [100.0 + late_s + left_s])


def test_a_late_wake_up_is_counted() -> None:
    _, loop, _, clock = puppet_loop()
    sleep = clock.sleep_until
    clock.sleep_until = lambda deadline_s: sleep(deadline_s + 0.01)  # type: ignore[method-assign]
    loop.run(lambda: loop.figures.cycles == 3)
    assert loop.figures.latest_wake_up_s == pytest.approx(0.01)
    assert loop.figures.missed == 0


def test_a_cycle_without_a_measurement_is_counted_as_not_on_time(caplog: pytest.LogCaptureFixture) -> None:
    _, loop, hardware, _ = puppet_loop()
    assert loop.figures.summary == "every cycle on time"
    hardware.faults = dict.fromkeys(JOINTS[:-1], JointFault("silent", "servo 1: silent"))
    loop.step()
    assert loop.figures.unmeasured == 0  # one joint was measured
    for _ in range(2):
        hardware.faults = dict.fromkeys(JOINTS, JointFault("silent", "servo 1: silent"))
        for _ in range(3):
            loop.step()
        hardware.faults = {}
        loop.step()
    loop.step()
    assert (loop.figures.unmeasured, loop.figures.summary) == (6, "6 cycles without a measurement")
    assert "no joint has been measured" not in caplog.text
    assert caplog.text.count("joint measurements have resumed after 3 cycles") == 1


def test_episodes_without_a_measurement_are_logged_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    _, loop, hardware, clock = puppet_loop()
    for wait_s in (0.0, 0.25, 0.25, 0.5, 1.0):
        clock.sleep_until(clock.now() + wait_s)
        hardware.faults = dict.fromkeys(JOINTS, JointFault("silent", "servo 1: silent"))
        loop.step()
        hardware.faults = {}
        loop.step()
    text = "joint measurements have resumed after 1 cycle without a measurement"
    assert [message for message in caplog.messages if "resumed" in message] == [
        text,
        f"{text} (2 earlier episodes not logged)",
        text,
    ]


def test_no_episode_is_logged_while_a_joint_is_measured(caplog: pytest.LogCaptureFixture) -> None:
    _, loop, hardware, _ = puppet_loop()
    hardware.faults = dict.fromkeys(JOINTS[:-1], JointFault("silent", "servo 1: silent"))
    loop.step()
    loop.step()
    assert caplog.messages == []


def test_an_inactive_component_does_not_count_as_unmeasured() -> None:
    _, loop, hardware, _ = puppet_loop()
    loop.component_transitions.ask("scripted", LifecycleState.UNCONFIGURED)
    for _ in range(5):
        loop.step()
    assert hardware.state is LifecycleState.UNCONFIGURED
    assert loop.figures.unmeasured == 0


@pytest.mark.parametrize("where", ["read", "write"])
def test_a_defect_leaves_the_loop_before_anything_is_written(where: str) -> None:
    _, loop, hardware, _ = puppet_loop()
    loop.step()
    hardware.failing[where] = RuntimeError("a defect")
    with pytest.raises(RuntimeError, match="a defect"):
        loop.run(lambda: loop.figures.cycles > 3)
    assert len(hardware.written) == 1


@pytest.mark.parametrize("where", ["read", "write"])
def test_the_loop_ends_when_its_only_component_is_lost(where: str) -> None:
    _, loop, hardware, _ = puppet_loop()
    loop.step()
    hardware.failing[where] = PortLost("the port is gone")
    with pytest.raises(PortLost, match="the port is gone"):
        loop.run(lambda: loop.figures.cycles > 3)
    assert len(hardware.written) == 1


def test_inactive_hardware_is_read_and_not_written() -> None:
    _, loop, hardware, _ = puppet_loop()
    hardware.state = LifecycleState.INACTIVE
    loop.step()
    assert hardware.written == []
    assert hardware.calls[-1] == "read"


def test_the_loop_starts_at_the_current_position_and_returns_slowly_to_the_limits() -> None:
    bench = Bench()
    bench.hardware._position = np.array([0.3, 2.05, -0.001])
    bench.up()
    np.testing.assert_allclose(bench.loop.command, [0.3, 2.05, -0.001])
    bench.cycle()
    np.testing.assert_allclose(bench.path()[-1], [0.3, 2.03, -0.0005])
    bench.cycle(3)
    np.testing.assert_allclose(bench.path()[-1], [0.3, 2.0, 0.0])


def test_the_loop_does_not_start_with_an_unmeasured_joint() -> None:
    """A joint that was never measured has no start position. The torque of this joint is disabled, and its name is
    reported."""
    bench = Bench()
    bench.hardware._position = np.array([0.3, NAN, 0.0])
    bench.hardware.configure()
    with pytest.raises(ActivationError, match="could not measure elbow"):
        bench.loop.activate()
    assert bench.hardware.calls[-1] == "relax"
    assert bench.hardware.state is LifecycleState.INACTIVE


def test_a_failed_start_disables_the_torque_and_logs_where_it_may_still_be_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """User-written hardware may be active although its activation has failed."""
    bench = Bench()
    bench.hardware.configure()
    activate = bench.hardware.activate

    def half_way() -> None:
        activate()
        raise ActivationError("elbow stays limp")

    monkeypatch.setattr(bench.hardware, "activate", half_way)
    bench.hardware.failing["relax"] = PortLost("the port is gone")
    with pytest.raises(ActivationError, match="elbow stays limp"):
        bench.loop.activate()
    assert bench.hardware.calls[-1] == "relax"
    assert "torque may still be on: could not switch off: the port is gone" in caplog.messages


class Wheels(Puppet):
    """Controller that commands a velocity and an effort."""

    command_interfaces = ("wheel/velocity", "motor/effort")
    state_interfaces = ("wheel/velocity",)


def wheels() -> tuple[Wheels, ControlLoop, MockHardware]:
    clock = SimulatedClock(100.0)
    commands = ("wheel/velocity", "motor/effort", "arm/position")
    hardware = MockHardware("mixed", ("wheel", "motor", "arm"), clock, command_interfaces=commands)
    components = ComponentSet([hardware], clock)
    limits = dict.fromkeys(hardware.joints, JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0, 3.0))
    manager = ControllerManager(components, limits)
    made = Wheels()
    manager.registry.add(made)
    loop = ControlLoop(components, manager, limits, clock, PERIOD_S)
    hardware.configure()
    loop.activate()
    return made, loop, hardware


def test_velocities_and_efforts_pass_the_gate() -> None:
    made, loop, hardware = wheels()
    np.testing.assert_array_equal(loop.command, [0.0, 0.0, 0.0])
    made.command = np.array([9.0, 9.0])
    speeds: list[float] = []
    for _ in range(10):
        loop.step()
        speeds.append(float(hardware.read().velocity[0]))
    np.testing.assert_allclose(speeds[:3], [0.5, 1.0, 1.5])
    assert speeds[-1] == 4.0
    assert hardware.read().effort[1] == 3.0
    made.command = np.array([NAN, NAN])
    loop.step()
    np.testing.assert_allclose(loop.command, [3.5, 0.0, 0.0])


def test_a_velocity_can_be_sent_before_the_first_measurement() -> None:
    _, loop, _ = wheels()
    loop.send(np.array([9.0, 0.0, 0.0]))
    np.testing.assert_allclose(loop.command, [0.5, 0.0, 0.0])


def test_an_interface_without_a_controller_neither_moves_nor_pushes() -> None:
    made, loop, _ = wheels()
    made.command = np.array([2.0, 2.0])
    for _ in range(5):
        loop.step()
    loop.manager.release(["wheel/velocity"], "the test")
    for _ in range(5):
        loop.step()
    np.testing.assert_allclose(loop.command, [0.0, 0.0, 0.0], atol=1e-9)


def test_joints_come_to_rest_after_their_controller_ends_during_a_motion() -> None:
    bench = Bench().up()
    bench.send(to(1.5, 0.0))
    bench.cycle(12)
    assert abs(bench.velocity[0]) > 1.0
    bench.manager.release(["elbow/position"], "the test")
    bench.cycle(20)
    velocity = np.diff(bench.path()[:, 0]) / PERIOD_S
    assert np.abs(np.diff(velocity)).max() <= ARM_LIMITS.acceleration * PERIOD_S * 1.2
    assert velocity[-1] == pytest.approx(0.0, abs=1e-6)


def test_a_new_controller_starts_where_the_joints_come_to_rest() -> None:
    puppet, loop, hardware, _ = puppet_loop()
    for step in range(1, 6):
        puppet.command = np.array([0.1 * step, 0.0, 0.0])
        loop.step()
    loop.manager.release(["shoulder/position"], "the test")
    loop.step()
    loop.manager.switch(SwitchRequest(activate=("puppet",)), loop.command)
    rest = puppet.command.copy()  # The command at activation.
    assert 0.5 < rest[0] < 1.5
    while loop.manager.stops.holds([0]):
        loop.step()
    np.testing.assert_allclose(loop.command, rest)
    velocity = np.diff(np.array(hardware.written)[:, 0]) / PERIOD_S
    assert np.abs(np.diff(velocity[4:])).max() <= LIMITS["shoulder"].acceleration * PERIOD_S * 1.2
    puppet.command = rest + np.array([0.01, 0.0, 0.0])
    loop.step()
    np.testing.assert_allclose(hardware.written[-1], rest + np.array([0.01, 0.0, 0.0]))


def test_the_gate_does_not_change_a_goal() -> None:
    """The controller itself stays within the limits. The safety gate only catches programming errors."""
    bench = Bench().up()
    handle = bench.send(to(1.9, -1.9, after_s=0.0))
    while not handle.done:
        bench.cycle()
        assert bench.loop.command[:2] == pytest.approx(bench.arm.command, abs=1e-9)


def test_times_and_missed_cycles_are_accumulated(caplog: pytest.LogCaptureFixture) -> None:
    puppet, loop, _, clock = puppet_loop()
    stalls = iter([0.12, 0.0, 0.07, 0.01])
    puppet.during_update = lambda: clock.sleep_until(clock.now() + next(stalls))
    loop.run(lambda: loop.figures.cycles == 4)
    figures = loop.figures
    assert (figures.missed, figures.summary) == (3, "3 cycles missed")
    assert figures.busy_s == pytest.approx(0.2)
    assert caplog.messages == [
        "missed 2 cycles of 3 at 20 Hz (66.67%), mostly because of computing: the slowest cycle was late or "
        "interrupted for 0.0 ms, read the bus for 0.0 ms and computed for 120.0 ms"
    ]


def test_a_loop_that_always_misses_cycles_logs_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    puppet, loop, _, clock = puppet_loop()
    stalls = iter([0.07, 0.07, 0.12, *[0.07] * 13])
    puppet.during_update = lambda: clock.sleep_until(clock.now() + next(stalls))
    loop.run(lambda: loop.figures.cycles == 16)
    first, second = caplog.messages
    assert first.startswith("missed 1 cycle of 2 at 20 Hz (50.00%)") and "computed for 70.0 ms" in first
    assert second.startswith("missed 11 cycles of 21 at 20 Hz (52.38%)") and "computed for 120.0 ms" in second


def test_a_report_of_missed_cycles_names_their_most_frequent_cause(caplog: pytest.LogCaptureFixture) -> None:
    figures = LoopFigures()
    assert figures.count_cycle(due_s=0.0, woke_s=1.75, now_s=2.75, period_s=1.0, computed_s=0.5) == 3.0
    figures.last_read_s = 1.4
    assert figures.count_cycle(due_s=3.0, woke_s=3.25, now_s=4.75, period_s=1.0, computed_s=9.0) == 5.0
    causes = [text.partition("because of ")[2].partition(":")[0] for text in caplog.messages]
    assert causes == ["the machine", "the bus"]
    assert "late or interrupted for 250.0 ms, read the bus for 1400.0 ms and computed for 100.0 ms" in caplog.text


def test_a_report_of_missed_cycles_names_the_rate_that_the_loop_kept(caplog: pytest.LogCaptureFixture) -> None:
    """Most cycles take 2.9 ms, so a rate of 400 Hz is too high. A single longer stall does not count."""
    figures, due_s = LoopFigures(), 0.0
    for cycle in range(600):
        took_s = 0.5 if cycle == 10 else 0.0029 if cycle % 3 == 0 else 0.001
        due_s = figures.count_cycle(due_s, due_s, due_s + took_s, 0.0025, took_s)
    assert len(caplog.messages) == 3
    assert caplog.messages[-1].endswith("This machine recently sustained 340 Hz: set update_rate to 340 or less")
    assert figures.recent.kept_hz == 340.0


def test_a_rare_stall_does_not_ask_for_another_rate(caplog: pytest.LogCaptureFixture) -> None:
    figures, due_s = LoopFigures(), 0.0
    for cycle in range(600):
        due_s = figures.count_cycle(due_s, due_s, due_s + (0.5 if cycle == 500 else 0.001), 0.0025, 0.001)
    (text,) = caplog.messages
    assert text.startswith("missed 200 cycles of 701 at 400 Hz (28.53%), mostly because of the machine")
    assert "kept" not in text


def test_the_log_contains_the_delay_of_a_late_wake_up(caplog: pytest.LogCaptureFixture) -> None:
    _, loop, _, clock = puppet_loop()
    sleep = clock.sleep_until
    clock.sleep_until = lambda deadline_s: sleep(deadline_s + 0.06)  # type: ignore[method-assign]
    loop.run(lambda: loop.figures.cycles == 1)
    assert "mostly because of the machine: the slowest cycle was late or interrupted for 60.0 ms" in caplog.text


def test_time_without_computing_is_the_delay_of_the_machine(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    puppet, loop, _, clock = puppet_loop()
    monkeypatch.setattr(loop_module, "computing_time", lambda clock: lambda: 50.0)
    puppet.during_update = lambda: clock.sleep_until(clock.now() + 0.06)
    loop.run(lambda: loop.figures.cycles == 1)
    assert "late or interrupted for 60.0 ms, read the bus for 0.0 ms and computed for 0.0 ms" in caplog.text


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_controllers_start_within_the_limits(side: float) -> None:
    bench = Bench()
    bench.hardware.place("shoulder", side * 2.15)
    assert bench.up().loop.within_limits.tolist() == [side * 2.0, 0.0, 0.0]


def test_joints_without_torque_are_still_measured() -> None:
    _, loop, hardware, _ = puppet_loop()
    hardware.faults = dict.fromkeys(JOINTS, JointFault("no_torque", "servo 1 returned with its torque disabled"))
    loop.step()
    assert loop.figures.summary == "every cycle on time"


def test_a_long_episode_without_a_measurement_is_logged_while_it_lasts(caplog: pytest.LogCaptureFixture) -> None:
    _, loop, hardware, _ = puppet_loop()
    hardware.faults = dict.fromkeys(JOINTS, JointFault("silent", "servo 1: silent"))
    for _ in range(3 * FAULT_CYCLES):
        loop.step()
    assert caplog.messages == [f"no joint has been measured for {FAULT_CYCLES} cycles: servo 1: silent"]


def test_one_cycle_without_a_measurement_is_logged_at_its_end(caplog: pytest.LogCaptureFixture) -> None:
    _, loop, hardware, _ = puppet_loop()
    hardware.faults = dict.fromkeys(JOINTS, JointFault("silent", "servo 1: silent"))
    loop.step()
    hardware.faults = {}
    loop.step()
    assert caplog.messages == ["joint measurements have resumed after 1 cycle without a measurement"]


def test_a_failing_callback_is_logged_once_and_ends_no_cycle(caplog: pytest.LogCaptureFixture) -> None:
    seen: list[JointState] = []

    def observe(state: JointState) -> None:
        seen.append(state)
        raise RuntimeError("a defect")

    clock = SimulatedClock(100.0)
    components = ComponentSet([ScriptedHardware(clock)], clock)
    loop = ControlLoop(components, ControllerManager(components, LIMITS), LIMITS, clock, PERIOD_S)
    loop.on_cycle = observe
    configure_all(components)
    loop.activate()
    for _ in range(3):
        loop.step()
    assert len(seen) == loop.figures.observer_errors == 3
    assert caplog.messages == ["the on_cycle callback failed; the loop continues"]


def test_a_velocity_brakes_before_the_end_of_the_measured_range() -> None:
    made, loop, hardware = wheels()
    hardware._position[:] = 1.99, 0.0, 0.0
    made.command = np.array([4.0, 0.0])
    for _ in range(3):
        loop.step()
    assert 0.0 < loop.command[0] < 0.2
    made.command = np.array([-4.0, 0.0])  # In this direction, the joint has room.
    for _ in range(10):
        loop.step()
    assert loop.command[0] == -4.0


def test_the_first_commands_hold_the_current_position() -> None:
    _, loop, _ = wheels()
    np.testing.assert_array_equal(loop.previous_command, loop.command)
    clock = SimulatedClock(100.0)
    interfaces = ("left/wheel/velocity", "left/arm/position")
    hardware = MockHardware("mixed", ("left/wheel", "left/arm"), clock, command_interfaces=interfaces)
    components = ComponentSet([hardware], clock)
    limits = {"left/wheel": JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0), "left/arm": ARM_LIMITS}
    fresh = ControlLoop(components, ControllerManager(components, limits), limits, clock, PERIOD_S)
    np.testing.assert_array_equal(fresh.command, [0.0, NAN])


def test_all_unmeasured_joints_are_named() -> None:
    clock = SimulatedClock(100.0)
    hardware = ScriptedHardware(clock)
    hardware._position[:2] = NAN
    components = ComponentSet([hardware], clock)
    loop = ControlLoop(components, ControllerManager(components, LIMITS), LIMITS, clock, PERIOD_S)
    configure_all(components)
    with pytest.raises(ActivationError, match=r"^not activated: could not measure shoulder, elbow"):
        loop.activate()


def test_an_unmeasured_joint_is_named_in_full() -> None:
    clock = SimulatedClock(100.0)
    hardware = MockHardware("arm", ("left/arm",), clock)
    hardware._position[:] = NAN
    components = ComponentSet([hardware], clock)
    limits = {"left/arm": ARM_LIMITS}
    loop = ControlLoop(components, ControllerManager(components, limits), limits, clock, PERIOD_S)
    configure_all(components)
    with pytest.raises(ActivationError, match=r"^not activated: could not measure left/arm"):
        loop.activate()


def test_hardware_without_command_interfaces_is_read() -> None:
    clock = SimulatedClock(100.0)
    hardware = MockHardware("sensors", JOINTS, clock, command_interfaces=())
    components = ComponentSet([hardware], clock)
    loop = ControlLoop(components, ControllerManager(components, LIMITS), LIMITS, clock, PERIOD_S)
    configure_all(components)
    loop.activate()
    assert loop.step().position.tolist() == [0.0, 0.0, 0.0]
    assert loop.command.shape == (0,)
