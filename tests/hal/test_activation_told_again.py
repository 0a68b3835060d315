"""An activation that is disturbed: which servos are let go, and what each is told before its torque is tried again."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from drivers.bus.retry import ATTEMPTS
from drivers.errors import DriverError
from drivers.servos import sts
from hal.errors import ActivationError
from hal.lifecycle import LifecycleState
from sim_backend.sts.firmware import StsVariant
from sim_backend.wire.instructions import Instruction
from sim_backend.wire.sts_wire import Code
from tests.hal.bench import IDS, JOINTS, Bench, switches_torque_on

BEFORE = (2048, 2000, 1500)
"""Where the joints stand when the activation begins, in counts."""


def on_first_torque_of(servo_id: int, bench: Bench, act: Callable[[], None]) -> None:
    """Lose the first torque switch that this servo is sent, and ``act`` then; it hears again 0.1 s later."""
    lost_s: list[float] = []

    def watch(number: int, instruction: Instruction) -> None:
        if lost_s and bench.clock.now() > lost_s[0] + 0.1:
            bench.servos.faults.restore(servo_id)
        elif not lost_s and switches_torque_on(instruction) and instruction.servo_id == servo_id:
            lost_s.append(bench.clock.now())
            bench.servos.faults.silence(servo_id)
            act()

    bench.port.before_write = watch


# Letting go


@pytest.mark.parametrize("held", [(1,), (7,), (1, 2)])
@pytest.mark.parametrize("fails", [sts.torque_limit, sts.torque_enable])
def test_an_arm_that_a_former_program_left_under_torque_is_not_dropped_when_activation_fails(
    held: tuple[int, ...], fails: sts.Register
) -> None:
    """Only the servos that were limp before are limp again."""
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


# Torque, told again


def test_joints_that_sink_while_a_torque_switch_is_repeated_are_measured_again() -> None:
    """The joint in question and those behind it are limp still; a goal from before would make them leap back."""
    bench = Bench(counts=BEFORE, variant=StsVariant(goal_write_energises=False)).configured()
    on_first_torque_of(2, bench, lambda: bench.place((2048, 1950, 1450)))
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert [bench.held(i, sts.goal_position) for i in IDS] == [2048, 1950, 1450]


def test_joints_that_their_goals_have_switched_on_keep_them_while_another_is_told_again() -> None:
    """They hold a load: to make where they give way to their goal would let them sink with every packet."""
    bench = Bench(counts=BEFORE).configured()

    def lean() -> None:
        bench.plant.load_nm[:] = [-1.0, -1.0, -1.0]

    on_first_torque_of(2, bench, lean)
    bench.hardware.activate()
    assert bench.measured(7) < BEFORE[2]
    assert [bench.held(i, sts.goal_position) for i in IDS] == list(BEFORE)


def test_a_joint_that_has_torque_keeps_its_goal_while_another_is_told_again() -> None:
    """What gives way a little under load must not sink further with every packet that is lost."""
    bench = Bench(counts=BEFORE).configured()

    def lean() -> None:
        bench.plant.load_nm[0] = -1.0

    on_first_torque_of(2, bench, lean)
    bench.hardware.activate()
    assert bench.measured(1) < 2040
    assert bench.held(1, sts.goal_position) == 2048


def test_a_joint_that_sank_out_of_its_limits_meanwhile_gets_no_torque() -> None:
    bench = Bench(counts=BEFORE, variant=StsVariant(goal_write_energises=False)).configured()
    on_first_torque_of(2, bench, lambda: bench.place((2048, 2000, 500)))
    with pytest.raises(ActivationError, match=r"finger \(servo 7\) is at .* outside its limits"):
        bench.hardware.activate()
    assert bench.torque() == []


def test_a_servo_that_was_reset_at_its_goal_of_zero_counts_has_its_torque_limit_again() -> None:
    """A reset servo holds goal 0. A joint that stands there has its goal nevertheless, but no torque limit any more."""
    finger = replace(JOINTS[2], zero_counts=0)
    bench = Bench(counts=(2048, 2000, 0), joints=(*JOINTS[:2], finger)).configured()
    on_first_torque_of(7, bench, bench.servos.servo(7).power_cycle)
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert bench.held(7, sts.torque_limit) == 500


@pytest.mark.parametrize("energises", [True, False])
def test_joints_that_sink_while_a_line_is_slow_to_confirm_their_goals_are_measured_again(energises: bool) -> None:
    """A servo that does not hear its goal has it written again: by then it may stand elsewhere."""
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
    """The next so many; returns all that this servo is sent, lost or not."""
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
def test_a_torque_switch_that_was_lost_is_told_again(packets: int) -> None:
    bench = Bench(counts=BEFORE).configured()
    sent = lose_torque_switches_of(2, bench, packets)
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert len(sent) == packets + 1


def test_a_torque_switch_that_never_arrives_ends_the_activation_and_nothing_has_torque() -> None:
    bench = Bench(counts=BEFORE).configured()
    sent = lose_torque_switches_of(2, bench, ATTEMPTS)
    with pytest.raises(DriverError, match="servo 2"):
        bench.hardware.activate()
    assert len(sent) == ATTEMPTS
    assert bench.torque() == []


# How far outside its limits a joint may stand


@pytest.mark.parametrize("upper", [True, False])
@pytest.mark.parametrize(("share", "accepted"), [(0.048, True), (0.052, False)])
def test_a_joint_may_stand_outside_its_limits_by_a_twentieth_of_their_span(
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


# What is told of a servo begins anew with each life


def test_a_fault_of_a_former_life_does_not_keep_a_new_one_out_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().active()
    bench.servos.faults.silence(2)
    bench.wait()
    bench.hardware.cleanup()
    bench.servos.faults.restore(2)
    caplog.clear()
    checks = len(Bench().configured().port.sent) - 1  # the last instruction of a configuration is the first reading
    bench.watch_next_port = lambda number, _: bench.servos.faults.silence(2) if number == checks else None
    bench.configured()
    assert bench.opened == 2
    assert caplog.text.count("servo 2 does not answer") == 1


def test_a_fault_before_a_refused_activation_is_told_again_after_it(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().configured()
    bench.servos.faults.silence(2)
    bench.wait()
    with pytest.raises((ActivationError, DriverError)):
        bench.hardware.activate()
    caplog.clear()
    bench.wait()
    assert caplog.text.count("servo 2 does not answer") == 1
