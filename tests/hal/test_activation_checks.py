"""Tests that each activation repeats all checks, because servos may have been changed, reset or replaced."""

from dataclasses import replace
from itertools import cycle

import pytest

from drivers.servos import sts
from drivers.servos.register import Register
from hal.hal_errors import ActivationError
from hal.lifecycle import LifecycleState
from hal.servos.activation import AGREE_COUNTS
from hal.servos.soft_torque import SOFT_SHARE
from sim_backend.packets.instructions import Instruction
from tests.hal.bench import IDS, JOINTS, Bench, at, switches_torque_on

SYNC_READ = 0x82
CALIBRATED = (replace(JOINTS[0], homing_offset=600, settings=(("position_p", 16),)), *JOINTS[1:])

CHANGES = [
    (sts.homing_offset, 0, "has homing_offset 0, but shoulder was calibrated with 600"),
    (sts.operating_mode, 1, "is not in position mode"),
    (sts.model_number, 1, r"is model 1 \(unknown\), not 777"),
    (sts.max_position, 2100, "has position limits 0 to 2100 counts"),
    (sts.status_level, 0, "does not acknowledge writes"),
]


def calibrated() -> Bench:
    bench = Bench(joints=CALIBRATED)
    bench.servos.servo(1).memory.put(sts.homing_offset, 600)
    return bench.configured()


@pytest.mark.parametrize("held", [False, True], ids=["limp", "held"])
@pytest.mark.parametrize(("register", "value", "message"), CHANGES, ids=[register.name for register, _, _ in CHANGES])
def test_a_servo_that_was_changed_while_inactive_gets_no_torque(
    register: Register, value: int, message: str, held: bool
) -> None:
    bench = calibrated()
    if held:
        bench.hardware.activate()
        bench.hardware.deactivate(relax=False)
    bench.servos.servo(1).memory.put(register, value)
    with pytest.raises(ActivationError, match=f"^not activated: shoulder: servo 1: {message}"):
        bench.hardware.activate()
    assert bench.hardware.state is LifecycleState.INACTIVE
    assert bench.torque() == (list(IDS) if held else []), "a servo with torque keeps holding"


def test_settings_of_a_factory_reset_servo_are_restored_before_torque() -> None:
    bench = calibrated()
    memory = bench.servos.servo(1).memory
    memory.put(sts.position_p, 32)
    bench.hardware.activate()
    assert (bench.held(1, sts.position_p), bench.torque()) == (16, list(IDS))


def test_a_servo_with_torque_and_other_settings_is_refused_and_keeps_holding() -> None:
    bench = calibrated()
    bench.hardware.activate()
    bench.hardware.deactivate(relax=False)
    bench.servos.servo(1).memory.put(sts.position_p, 32)
    with pytest.raises(
        ActivationError, match=r"^not activated: shoulder: servo 1: position_p .*the torque of the servo is enabled"
    ):
        bench.hardware.activate()
    assert bench.torque() == list(IDS)


# Reactivation of one servo while the others hold


def reset(bench: Bench, servo_id: int = 2) -> None:
    """Interrupt the power of a servo. The servo is silent for a moment and then answers without torque."""
    bench.servos.servo(servo_id).power_cycle()
    bench.wait()
    for _ in range(20):
        if bench.wait().faults:
            return
    raise AssertionError("never noticed")


def test_a_reset_servo_is_activated_where_it_is_and_the_others_keep_their_goals() -> None:
    bench = calibrated()
    bench.hardware.activate()
    bench.cycle(at(0.1, 0.1, 0.01))
    reset(bench)
    before = {i: bench.held(i, sts.goal_position) for i in (1, 7)}
    bench.place((bench.measured(1), 1800, bench.measured(7)))
    bench.port.sent.clear()
    assert bench.hardware.without_torque == {"elbow"}
    assert bench.hardware.reactivate() == {"elbow"}
    assert bench.torque() == list(IDS)
    assert bench.held(2, sts.goal_position) == 1800
    assert {i: bench.held(i, sts.goal_position) for i in (1, 7)} == before
    written = [i for i in bench.port.sent if i.code == 0x83 and i.parameters[0] in range(40, 50)]
    assert [len(i.parameters) for i in written] == [10], "the goal of one servo"
    assert bench.wait().faults == {}
    assert bench.hardware.without_torque == frozenset()


@pytest.mark.parametrize(
    ("register", "value"), [(sts.homing_offset, 0), (sts.operating_mode, 1)], ids=lambda one: getattr(one, "name", "")
)
def test_a_replaced_servo_gets_no_torque_and_the_component_stays_active(register: Register, value: int) -> None:
    bench = calibrated()
    bench.hardware.activate()
    reset(bench, 1)
    bench.servos.servo(1).memory.put(register, value)
    with pytest.raises(ActivationError, match=r"^not activated: shoulder: servo 1: "):
        bench.hardware.reactivate()
    assert (bench.hardware.state, bench.torque()) == (LifecycleState.ACTIVE, [2, 7])
    assert set(bench.wait().faults) == {"shoulder"} == bench.hardware.without_torque
    bench.cycle(at(0.0, 0.0, 0.01))
    assert bench.torque() == [2, 7], "a goal would enable its torque"


def test_a_reactivation_that_fails_leaves_its_servo_limp_and_the_others_holding() -> None:
    bench = calibrated()
    bench.hardware.activate()
    reset(bench)

    def interrupt(number: int, instruction: Instruction) -> None:
        if switches_torque_on(instruction):
            bench.port.before_write = lambda number, instruction: None
            raise KeyboardInterrupt

    bench.port.before_write = interrupt
    with pytest.raises(KeyboardInterrupt):
        bench.hardware.reactivate()
    assert bench.torque() == [1, 7]
    assert bench.hardware.without_torque == {"elbow"}


def wobbling(apart_counts: int) -> Bench:
    """Create a bench whose shoulder is at one of two positions in turn when its position is read."""
    bench = Bench().configured()
    at_counts = cycle([2048, 2048 + apart_counts])

    def wobble(number: int, instruction: Instruction) -> None:
        if instruction.code == SYNC_READ and instruction.parameters[0] == sts.present_position.address:
            bench.place([next(at_counts), 2000, 1500])

    bench.port.before_write = wobble
    return bench


def test_a_joint_whose_readings_differ_gets_no_torque() -> None:
    bench = wobbling(AGREE_COUNTS + 27)  # within 10 ms, the shoulder could travel 26 counts
    differ = r"two readings of shoulder .* differ \((2048, then 2078|2078, then 2048) counts\). Hold the arm still"
    with pytest.raises(ActivationError, match=f"^not activated: {differ}"):
        bench.hardware.activate()
    assert bench.torque() == []


def test_a_joint_that_sways_slowly_is_activated() -> None:
    bench = wobbling(26)
    bench.hardware.activate()
    assert bench.torque() == list(IDS)


@pytest.mark.parametrize("relax", [False, True])
def test_a_held_arm_gets_its_full_torque_limits_back(relax: bool) -> None:
    bench = Bench().active()
    full = bench.held(1, sts.torque_limit)
    assert bench.hardware.soft_torque.reduce() == []
    reduced = bench.held(1, sts.torque_limit)
    assert reduced == round(1000 * SOFT_SHARE)
    bench.hardware.deactivate(relax)
    assert bench.held(1, sts.torque_limit) == (reduced if relax else full)
