"""Tests of disturbed activations: which servos are released, and which steps are repeated before torque is enabled."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import DriverError
from drivers.servos import sts
from drivers.servos.register import Register
from hal.hal_errors import ActivationError
from hal.lifecycle import LifecycleState
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import Code
from sim_backend.servos.sts.firmware import StsVariant
from tests.hal.bench import IDS, JOINTS, Bench, switches_torque_on

BEFORE = (2048, 2000, 1500)
"""Positions of the joints at the beginning of an activation, in counts."""


def on_first_torque_of(servo_id: int, bench: Bench, act: Callable[[], None]) -> None:
    """Lose the first torque write to a servo, and then call ``act``. The servo receives packets again 0.1 s later."""
    lost_s: list[float] = []

    def watch(number: int, instruction: Instruction) -> None:
        if lost_s and bench.clock.now() > lost_s[0] + 0.1:
            bench.servos.faults.restore(servo_id)
        elif not lost_s and switches_torque_on(instruction) and instruction.servo_id == servo_id:
            lost_s.append(bench.clock.now())
            bench.servos.faults.silence(servo_id)
            act()

    bench.port.before_write = watch


# Release after a failure


@pytest.mark.parametrize("held", [(1,), (7,), (1, 2)])
@pytest.mark.parametrize("fails", [sts.torque_limit, sts.torque_enable])
def test_a_failed_activation_does_not_release_servos_that_had_torque_before(
    held: tuple[int, ...], fails: Register
) -> None:
    """Only servos that were limp before are released."""
    bench = Bench().configured()
    for servo_id in held:
        bench.servos.servo(servo_id).memory.put(sts.goal_position, bench.measured(servo_id))
        bench.servos.servo(servo_id).memory.put(sts.torque_enable, 1)
    last = next(servo_id for servo_id in reversed(IDS) if servo_id not in held)

    def interrupt(number: int, instruction: Instruction) -> None:
        if instruction.code == 3 and (instruction.servo_id, instruction.parameters[0]) == (last, fails.address):
            bench.port.before_write = lambda number, instruction: None
            raise KeyboardInterrupt

    bench.port.before_write = interrupt
    with pytest.raises(KeyboardInterrupt):
        bench.hardware.activate()
    assert bench.torque() == list(held)
    assert bench.hardware.state is LifecycleState.INACTIVE


# Repeated torque writes


def test_joints_that_sink_while_a_torque_write_is_retried_are_measured_again() -> None:
    """This joint and all joints after it are still limp. Old goals would make the joints jump back."""
    bench = Bench(counts=BEFORE, variant=StsVariant(goal_write_energises=False)).configured()
    on_first_torque_of(2, bench, lambda: bench.place((2048, 1950, 1450)))
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert [bench.held(i, sts.goal_position) for i in IDS] == [2048, 1950, 1450]


def test_joints_enabled_by_their_goals_keep_them_while_another_is_retried() -> None:
    """The joints hold a load. If the sagged positions became goals, the joints would sag further with every packet."""
    bench = Bench(counts=BEFORE).configured()

    def lean() -> None:
        bench.plant.load_nm[:] = [-1.0, -1.0, -1.0]

    on_first_torque_of(2, bench, lean)
    bench.hardware.activate()
    assert bench.measured(7) < BEFORE[2]
    assert [bench.held(i, sts.goal_position) for i in IDS] == list(BEFORE)


def test_a_joint_with_torque_keeps_its_goal_while_another_is_retried() -> None:
    """A joint that sags under load must not sag further with every lost packet."""
    bench = Bench(counts=BEFORE).configured()

    def lean() -> None:
        bench.plant.load_nm[0] = -1.0

    on_first_torque_of(2, bench, lean)
    bench.hardware.activate()
    assert bench.measured(1) < 2040
    assert bench.held(1, sts.goal_position) == 2048


def test_a_joint_that_sinks_beyond_its_limits_gets_no_torque() -> None:
    bench = Bench(counts=BEFORE, variant=StsVariant(goal_write_energises=False)).configured()
    on_first_torque_of(2, bench, lambda: bench.place((2048, 2000, 500)))
    with pytest.raises(ActivationError, match=r"finger \(servo 7\) is at .* outside its limits"):
        bench.hardware.activate()
    assert bench.torque() == []


def test_the_torque_limit_of_a_servo_reset_at_goal_zero_is_restored() -> None:
    """A reset servo has goal 0. At position 0, this goal is correct, but the torque limit has been lost."""
    finger = replace(JOINTS[2], zero_counts=0)
    bench = Bench(counts=(2048, 2000, 0), joints=(*JOINTS[:2], finger)).configured()
    on_first_torque_of(7, bench, bench.servos.servo(7).power_cycle)
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert bench.held(7, sts.torque_limit) == 500


@pytest.mark.parametrize("energises", [True, False])
def test_joints_that_sink_while_goals_are_confirmed_slowly_are_measured_again(energises: bool) -> None:
    """A lost goal is written again. The joint may have moved in the meantime."""
    bench = Bench(counts=BEFORE, variant=StsVariant(goal_write_energises=energises)).configured()
    lost_s: list[float] = []

    def watch(number: int, instruction: Instruction) -> None:
        if not lost_s and instruction.code == Code.SYNC_WRITE:
            lost_s.append(bench.clock.now())
            bench.servos.faults.silence(7)
        elif lost_s and bench.clock.now() > lost_s[0] + 0.12:
            bench.servos.faults.restore(7)
            bench.place((2048, 2000, 1450))
            bench.port.before_write = lambda number, instruction: None

    bench.port.before_write = watch
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert [bench.held(i, sts.goal_position) for i in IDS] == [2048, 2000, 1450]


def lose_torque_switches_of(servo_id: int, bench: Bench, packets: int) -> list[Instruction]:
    """Lose the next packets to a servo. Return all packets that are sent to the servo, including the lost packets."""
    sent: list[Instruction] = []

    def watch(number: int, instruction: Instruction) -> None:
        bench.servos.faults.restore(servo_id)
        if switches_torque_on(instruction) and instruction.servo_id == servo_id:
            sent.append(instruction)
            if len(sent) <= packets:
                bench.servos.faults.silence(servo_id)

    bench.port.before_write = watch
    return sent


@pytest.mark.parametrize("packets", range(1, ATTEMPTS))
def test_a_lost_torque_write_is_repeated(packets: int) -> None:
    bench = Bench(counts=BEFORE).configured()
    sent = lose_torque_switches_of(2, bench, packets)
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert len(sent) == packets + 1


def test_a_torque_write_that_never_arrives_ends_the_activation_without_torque() -> None:
    bench = Bench(counts=BEFORE).configured()
    sent = lose_torque_switches_of(2, bench, ATTEMPTS)
    with pytest.raises(DriverError, match="servo 2"):
        bench.hardware.activate()
    assert len(sent) == ATTEMPTS
    assert bench.torque() == []


# Distance of a joint from its limits


@pytest.mark.parametrize("upper", [True, False])
@pytest.mark.parametrize(("share", "accepted"), [(0.048, True), (0.052, False)])
def test_a_joint_may_be_outside_its_limits_by_five_percent_of_its_range(
    upper: bool, share: float, accepted: bool
) -> None:
    shoulder = JOINTS[0]
    span = shoulder.limits.upper - shoulder.limits.lower
    position = shoulder.limits.upper + share * span if upper else shoulder.limits.lower - share * span
    counts = round(position / shoulder.units_per_count) + shoulder.zero_counts
    bench = Bench(counts=(counts, 2000, 1500)).configured()
    if accepted:
        bench.hardware.activate()
        assert bench.held(1, sts.goal_position) == counts
    else:
        with pytest.raises(ActivationError, match=r"shoulder \(servo 1\) is at .*, outside its limits"):
            bench.hardware.activate()
    assert bench.torque() == (list(IDS) if accepted else [])


# Faults are logged again after a new configuration


def test_a_fault_is_logged_again_after_a_new_configuration(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().active()
    bench.servos.faults.silence(2)
    bench.wait()
    bench.hardware.cleanup()
    bench.servos.faults.restore(2)
    caplog.clear()
    checks = (
        len(Bench().configured().port.sent) - 1
    )  # the last packet of a configuration is already the first read of a state
    bench.watch_next_port = lambda number, _: bench.servos.faults.silence(2) if number == checks else None
    bench.configured()
    assert bench.opened == 2
    assert caplog.text.count("servo 2 does not respond") == 1


def test_a_fault_is_logged_again_after_a_refused_activation(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().configured()
    bench.servos.faults.silence(2)
    bench.wait()
    with pytest.raises((ActivationError, DriverError)):
        bench.hardware.activate()
    caplog.clear()
    bench.wait()
    assert caplog.text.count("servo 2 does not respond") == 1
