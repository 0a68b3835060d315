"""Tests of configuration and activation: torque is enabled only with every goal at the measured position."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import DriverError, PortLost, PortMissing, ServoRefused
from drivers.servos import sts
from hal.gate import RETURN_SHARE
from hal.hal_errors import ActivationError, LifecycleError
from hal.lifecycle import LifecycleState
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointCommand
from sim_backend.clock import SimulatedClock
from sim_backend.packets.instructions import Instruction
from tests.hal.bench import IDS, JOINTS, NAMES, PERIOD_S, Bench, at, joint_of, switches_torque, switches_torque_on

UNCONFIGURED, INACTIVE, ACTIVE = LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE, LifecycleState.ACTIVE

# Configuration


def test_configuring_writes_nothing() -> None:
    bench = Bench()
    before = [bytes(servo.memory.read(0, 56)) for servo in bench.servos.servos]
    bench.hardware.configure()
    assert bench.hardware.state is INACTIVE
    assert [bytes(servo.memory.read(0, 56)) for servo in bench.servos.servos] == before
    assert {instruction.code for instruction in bench.port.sent} <= {0x01, 0x02, 0x82}


def test_a_configured_arm_knows_its_position() -> None:
    bench = Bench(counts=(2148, 2100, 1124)).configured()
    state = bench.hardware.read()
    count = 2.0 * np.pi / 4096
    np.testing.assert_allclose(state.position, [100 * count, -100 * count, 100 * count * 0.03])
    assert state.faults == {}
    assert set(state.health) == set(NAMES)
    assert state.stamp_s == bench.clock.now()


def test_a_silent_servo_is_reported_and_the_port_is_closed() -> None:
    bench = Bench()
    bench.servos.faults.silence(2)
    with pytest.raises(DriverError, match=r"^elbow: servo 2: does not respond at any baud rate") as caught:
        bench.hardware.configure()
    assert "shoulder" not in str(caught.value)
    assert bench.hardware.state is UNCONFIGURED
    with pytest.raises(PortLost):
        bench.port.write(b"")


def test_all_wrong_servos_are_reported_together() -> None:
    bench = Bench()
    bench.servos.faults.silence(1)
    bench.servos.servo(7).memory.put(sts.model_number, 1)
    with pytest.raises(DriverError) as caught:
        bench.hardware.configure()
    shoulder, finger = str(caught.value).splitlines()
    assert shoulder.startswith("shoulder: servo 1: does not respond")
    assert finger.startswith("finger: servo 7: is model 1 (unknown), not 777 (sts3215)")


def test_if_no_servo_answers_the_bus_is_reported() -> None:
    bench = Bench()
    for servo_id in IDS:
        bench.servos.faults.silence(servo_id)
    with pytest.raises(DriverError, match=r"^no servo responds on virtual at any baud rate: check the servos' power"):
        bench.hardware.configure()


def test_servos_of_a_wrong_model_are_not_reported_as_silent() -> None:
    bench = Bench()
    for servo in bench.servos.servos:
        servo.memory.put(sts.model_number, 1)
    with pytest.raises(DriverError) as caught:
        bench.hardware.configure()
    assert len(str(caught.value).splitlines()) == len(JOINTS)
    assert "no servo responds" not in str(caught.value)


def test_a_port_that_does_not_open_leaves_the_arm_unconfigured() -> None:
    def missing() -> None:
        raise PortMissing("there is no /dev/ttyACM0")

    hardware = ServoHardware("arm", JOINTS, missing, SimulatedClock())  # type: ignore[arg-type]
    with pytest.raises(PortMissing):
        hardware.configure()
    assert hardware.state is UNCONFIGURED


@pytest.mark.parametrize("after", range(4))
def test_a_port_lost_during_configuration_is_closed(after: int) -> None:
    bench = Bench()
    bench.port.before_write = lambda number, _: bench.port.port.unplug() if number == after else None
    with pytest.raises(PortLost):
        bench.hardware.configure()
    assert bench.hardware.state is UNCONFIGURED
    bench.hardware.configure()
    assert (bench.hardware.state, bench.opened) == (INACTIVE, 2)


# Activation


def test_no_torque_before_every_goal_is_the_measured_position() -> None:
    bench = Bench(counts=(2148, 1900, 1500)).configured()
    seen: list[tuple[int, list[tuple[int, int]]]] = []

    def watch(number: int, instruction: Instruction) -> None:
        if switches_torque_on(instruction):
            seen.append((instruction.servo_id, [(bench.held(i, sts.goal_position), bench.measured(i)) for i in IDS]))

    bench.port.before_write = watch
    bench.hardware.activate()
    assert [servo_id for servo_id, _ in seen] == list(IDS)
    for _, goals in seen:
        assert goals == [(2148, 2148), (1900, 1900), (1500, 1500)]
    assert bench.torque() == list(IDS)


def test_the_goals_have_been_read_back_before_the_first_torque() -> None:
    bench = Bench().configured()
    bench.port.sent.clear()
    bench.hardware.activate()
    goal = bytes((sts.goal_position.address, 2))
    read_back = [n for n, i in enumerate(bench.port.sent) if i.code == 2 and i.parameters == goal]
    torque = [n for n, i in enumerate(bench.port.sent) if switches_torque_on(i)]
    sync_writes = [n for n, i in enumerate(bench.port.sent) if i.code == 0x83]
    assert len(read_back) == len(torque) == len(IDS)
    assert len(sync_writes) == 1
    assert sync_writes[0] < min(read_back) and max(read_back) < min(torque)


def test_the_torque_limits_are_set_before_the_torque() -> None:
    bench = Bench().active()
    assert [bench.held(i, sts.torque_limit) for i in IDS] == [999, 999, 500]  # the value after power-on is 1000
    limits = [n for n, i in enumerate(bench.port.sent) if i.code == 3 and i.parameters[0] == sts.torque_limit.address]
    assert max(limits) < min(n for n, i in enumerate(bench.port.sent) if switches_torque_on(i))


def test_nothing_moves_when_torque_is_enabled() -> None:
    bench = Bench(counts=(3000, 1200, 2000))
    bench.servos.servo(1).memory.put(sts.goal_position, 100)  # left over from another program
    bench.active()
    for _ in range(10):
        bench.wait()
        assert [bench.measured(i) for i in IDS] == pytest.approx([3000, 1200, 2000], abs=2)


def test_the_position_at_configuration_does_not_matter() -> None:
    bench = Bench().configured()
    bench.place((2500, 1500, 1800))
    bench.hardware.activate()
    assert [bench.held(i, sts.goal_position) for i in IDS] == [2500, 1500, 1800]


def test_the_measured_position_is_kept_even_if_the_next_readings_fail() -> None:
    """Controllers start from this position. If controllers started from the position at configuration, they would make
    the joints jump."""
    bench = Bench().configured()
    bench.place((2500, 1500, 1800))

    def corrupt(number: int, instruction: Instruction) -> None:
        if switches_torque_on(instruction) and instruction.servo_id == IDS[-1]:
            bench.servos.faults.corrupt_next(1, replies=9)

    bench.port.before_write = corrupt
    bench.hardware.activate()
    state = bench.hardware.read()
    assert "shoulder" in state.faults
    assert state.position[0] == pytest.approx(JOINTS[0].position(2500), abs=0.005)


# Refusals


def silence_elbow(bench: Bench) -> None:
    bench.servos.faults.silence(2)


def corrupt_elbow(bench: Bench) -> None:
    bench.servos.faults.corrupt_next(2, replies=ATTEMPTS)  # in each retry


def turn_elbow_out(bench: Bench) -> None:
    bench.place((2048, 2000 + 1200, 1500))  # -1.84 rad


@pytest.mark.parametrize(
    ("disturb", "expected"),
    [
        (silence_elbow, "elbow: servo 2 does not respond"),
        (corrupt_elbow, "elbow: servo 2 replied with a wrong checksum"),
        (
            turn_elbow_out,
            r"elbow \(servo 2\) is at -1.8408, outside its limits -1.5000 to 1.5000. Move the joint by hand, or "
            "calibrate the arm with 'servoloop calibrate'",
        ),
    ],
)
def test_a_refusal_contains_the_joint_and_no_servo_gets_torque(disturb: Callable[[Bench], None], expected: str) -> None:
    bench = Bench().configured()
    disturb(bench)
    with pytest.raises(ActivationError, match=f"not activated: {expected}"):
        bench.hardware.activate()
    assert bench.torque() == []
    assert not any(switches_torque_on(instruction) for instruction in bench.port.sent)
    assert bench.hardware.state is INACTIVE


def test_activation_can_be_retried_after_a_refusal() -> None:
    bench = Bench().configured()
    bench.servos.faults.silence(2)
    with pytest.raises(ActivationError):
        bench.hardware.activate()
    bench.servos.faults.restore(2)
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert bench.hardware.read().faults == {}


def test_every_silent_servo_is_in_the_refusal() -> None:
    bench = Bench().configured()
    bench.servos.faults.silence(1)
    bench.servos.faults.silence(7)
    with pytest.raises(ActivationError, match=r"shoulder: servo 1 .*; finger: servo 7 "):
        bench.hardware.activate()


@pytest.mark.parametrize("side", [1, -1])
def test_a_joint_slightly_outside_its_limits_is_held_and_returns_slowly(side: int) -> None:
    shoulder = JOINTS[0]
    end = 2048 + side * 1303
    begin = end + side * 100  # 0.15 rad further
    bench = Bench(counts=(begin, 2000, 1500)).active()
    assert bench.held(1, sts.goal_position) == begin
    reach = RETURN_SHARE * shoulder.limits.velocity * PERIOD_S / shoulder.units_per_count
    goal, target = begin, shoulder.position(end)
    for _ in range(8):
        bench.cycle(at(target, 0.0, 0.014))
        before, goal = goal, bench.held(1, sts.goal_position)
        assert abs(goal - before) <= reach + 1
    assert goal == end


# Failures during activation

CHECKS = len(IDS) * 7 + 1
STEPS = 1 + CHECKS + len(IDS) * 6 + 1 + 4
"""An activation sends these instructions: it measures, checks, and measures twice. For each servo, it writes torque,
two limits, goal and torque on. Then it writes all goals."""

Disturbance = Callable[[Bench], None]


def one_goes_silent(servo_id: int) -> Disturbance:
    return lambda bench: bench.servos.faults.silence(servo_id)


def one_is_corrupt(servo_id: int) -> Disturbance:
    return lambda bench: bench.servos.faults.corrupt_next(servo_id)


def interrupted(bench: Bench) -> None:
    def once() -> None:
        bench.port.before_read = lambda: None
        raise KeyboardInterrupt

    bench.port.before_read = once


DISTURBANCES = [*map(one_goes_silent, IDS), *map(one_is_corrupt, IDS), interrupted]
DISTURBANCE_NAMES = [*(f"silent{i}" for i in IDS), *(f"corrupt{i}" for i in IDS), "interrupted"]


@pytest.mark.parametrize("disturb", DISTURBANCES, ids=DISTURBANCE_NAMES)
@pytest.mark.parametrize("step", range(STEPS))
def test_a_failure_at_any_step_leaves_no_servo_with_torque(
    step: int, disturb: Disturbance, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench().configured()
    begin = len(bench.port.sent)
    bench.port.before_write = lambda number, _: disturb(bench) if number == begin + step else None
    try:
        bench.hardware.activate()
    except (DriverError, ActivationError, KeyboardInterrupt):
        assert bench.hardware.state is INACTIVE
        out_of_reach = [i for i in IDS if bench.servos.faults.is_silent(i)]
        assert set(bench.torque()) <= set(out_of_reach)
        for servo_id in bench.torque():
            assert f"servo {servo_id}: does not respond" in caplog.text, "a servo with torque must be reported"
    else:  # the failure occurred after the activation
        assert bench.hardware.state is ACTIVE
        assert bench.torque() == list(IDS)


def test_a_servo_that_cannot_be_released_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().configured()

    def cut(number: int, instruction: Instruction) -> None:
        if switches_torque_on(instruction) and instruction.servo_id == IDS[-1]:
            bench.servos.faults.silence(1)
            bench.servos.faults.silence(7)

    bench.port.before_write = cut
    with pytest.raises(DriverError, match="servo 7: does not respond"):
        bench.hardware.activate()
    assert bench.torque() == [1, 7]
    for servo_id in (1, 7):
        expected = f"torque may still be on: servo {servo_id}: does not respond"
        assert any(message.startswith(expected) for message in caplog.messages)


def test_the_tests_disturb_every_step_of_an_activation() -> None:
    bench = Bench().configured()
    begin = len(bench.port.sent)
    bench.hardware.activate()
    last = max(n for n, instruction in enumerate(bench.port.sent) if switches_torque_on(instruction))
    assert last - begin + 1 == STEPS


@pytest.mark.parametrize("servo_id", IDS)
def test_a_servo_reset_while_torque_is_enabled_gets_no_torque(servo_id: int) -> None:
    """A supply dip resets the servo. The servo is silent for a while and loses its goal and its torque limit."""
    bench = Bench().configured()
    reset_s: list[float] = []

    def dip(number: int, instruction: Instruction) -> None:
        if reset_s and bench.clock.now() > reset_s[0] + 0.1:
            bench.servos.faults.restore(servo_id)
        elif not reset_s and switches_torque_on(instruction) and instruction.servo_id == servo_id:
            reset_s.append(bench.clock.now())
            bench.servos.faults.silence(servo_id)
            bench.servos.servo(servo_id).power_cycle()

    bench.port.before_write = dip
    before = bench.measured(servo_id)
    with pytest.raises(ActivationError, match=rf"\(servo {servo_id}\) has goal 0 instead of {before}. Check the cable"):
        bench.hardware.activate()
    assert bench.torque() == []
    assert bench.measured(servo_id) == before


@pytest.mark.parametrize("packets", range(1, ATTEMPTS))
def test_lost_goals_are_sent_again(packets: int) -> None:
    bench = Bench().configured()
    lost: list[Instruction] = []

    def lose(number: int, instruction: Instruction) -> None:
        bench.servos.faults.restore(2)
        if instruction.code == 0x83 and len(lost) < packets:
            lost.append(instruction)
            bench.servos.faults.silence(2)

    bench.port.before_write = lose
    bench.hardware.activate()
    assert len(lost) == packets and bench.torque() == list(IDS)


def test_a_goal_that_did_not_arrive_is_noticed() -> None:
    bench = Bench().configured()

    def lose(number: int, instruction: Instruction) -> None:
        alone = instruction.code == 3 and instruction.parameters[0] == sts.GOAL_BLOCK[0].address
        if instruction.code == 0x83 or alone:
            bench.servos.faults.silence(2)
        elif bench.servos.faults.is_silent(2):
            bench.servos.faults.restore(2)

    bench.port.before_write = lose
    with pytest.raises(ActivationError, match=r"elbow \(servo 2\) has goal 0 instead of 2000. Check the cable"):
        bench.hardware.activate()
    assert bench.torque() == []


@pytest.mark.parametrize("step", range(STEPS))
def test_a_port_lost_at_any_step_leaves_the_arm_inactive(step: int) -> None:
    bench = Bench().configured()
    begin = len(bench.port.sent)
    bench.port.before_write = lambda number, _: bench.port.port.unplug() if number == begin + step else None
    with pytest.raises(PortLost):
        bench.hardware.activate()
    assert bench.hardware.state is INACTIVE
    bench.hardware.cleanup()
    assert bench.hardware.state is UNCONFIGURED


# Life cycle


def configure(hardware: ServoHardware) -> None:
    hardware.configure()


def activate(hardware: ServoHardware) -> None:
    hardware.activate()


def deactivate(hardware: ServoHardware) -> None:
    hardware.deactivate(relax=True)


def read(hardware: ServoHardware) -> None:
    hardware.read()


def write(hardware: ServoHardware) -> None:
    hardware.write(JointCommand(at(0.0, 0.0, 0.0), PERIOD_S))


@pytest.mark.parametrize(
    ("before", "call", "expected"),
    [
        ((), activate, "cannot activate while unconfigured: the component must be inactive"),
        ((), deactivate, "cannot deactivate while unconfigured: the component must be active"),
        ((), read, "cannot read while unconfigured: the component must be inactive or active"),
        ((), write, "cannot write while unconfigured: the component must be active"),
        ((configure,), configure, "cannot configure while inactive: the component must be unconfigured"),
        ((configure,), deactivate, "cannot deactivate while inactive: the component must be active"),
        ((configure,), write, "cannot write while inactive: the component must be active"),
        ((configure, activate), configure, "cannot configure while active: the component must be unconfigured"),
        ((configure, activate), activate, "cannot activate while active: the component must be inactive"),
        ((configure, activate, deactivate), write, "cannot write while inactive"),
        ((configure, activate, deactivate), deactivate, "cannot deactivate while inactive"),
    ],
)
def test_calls_in_the_wrong_state(
    before: Sequence[Callable[[ServoHardware], None]], call: Callable[[ServoHardware], None], expected: str
) -> None:
    bench = Bench()
    for step in before:
        step(bench.hardware)
    state, torque, sent = bench.hardware.state, bench.torque(), len(bench.port.sent)
    with pytest.raises(LifecycleError, match=expected):
        call(bench.hardware)
    assert (bench.hardware.state, bench.torque(), len(bench.port.sent)) == (state, torque, sent)


def test_cleanup_is_allowed_in_every_state_and_keeps_the_torque() -> None:
    for make in (Bench, lambda: Bench().configured(), lambda: Bench().active()):
        bench = make()
        torque = bench.torque()
        bench.hardware.cleanup()
        bench.hardware.cleanup()
        assert bench.hardware.state is UNCONFIGURED
        assert bench.torque() == torque
        assert not any(switches_torque(i) and not switches_torque_on(i) for i in bench.port.sent)


def test_an_arm_can_be_configured_again_after_cleanup() -> None:
    bench = Bench().active()
    bench.servos.faults.silence(2)
    assert bench.wait().faults
    bench.servos.faults.restore(2)
    bench.hardware.cleanup()
    bench.active()
    assert bench.opened == 2
    assert bench.hardware.read().faults == {}
    assert joint_of(2).name == "elbow"


def test_a_refused_torque_is_reported_as_the_servo_reports_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Servos of some makes have no register that contains the reason for a refusal."""
    bench = Bench().configured()

    def refuse(bus: Bus, servo_id: int, *, prepared: bool) -> None:
        raise ServoRefused(servo_id, "answered an error")

    monkeypatch.setattr(Bus, "torque_on", refuse)
    with pytest.raises(ServoRefused, match=r"^servo 1: answered an error$"):
        bench.hardware.activate()
    assert bench.torque() == []
