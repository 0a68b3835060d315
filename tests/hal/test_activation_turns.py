"""Tests of servos that count turns: they report the position within one turn, but their goals cover several turns."""

import math
from dataclasses import replace

import pytest

from drivers.bus.single_servo import SingleServo
from drivers.driver_errors import ServoRefused, ServoSilent
from drivers.servos import sts
from hal.hal_errors import ActivationError
from hal.servos.fault_log import FaultLog
from hal.servos.servo_setup import forget_turns
from hal.servos.start_goal import counted_turns
from hal.types import JointCommand
from tests.hal.bench import JOINTS, PERIOD_S, Bench

TURN = 4096
ELBOW = 2


def turned_once_round(bench: Bench, way: int = 1) -> None:
    """Turn the elbow by hand by a full turn, back to the same position."""
    for step in range(1, 65):
        elbow = 2000 + way * step * TURN // 64
        bench.plant.place([(counts + 0.5) / TURN * math.tau for counts in (2048, elbow, 1500)])
        bench.clock.sleep_until(bench.clock.now() + 0.005)
        bench.servos.advance(bench.clock.now())


def shaft_counts(bench: Bench) -> list[float]:
    return [angle / math.tau * TURN for angle in bench.plant.joints.position]


@pytest.mark.parametrize("way", [1, -1])
def test_a_limp_servo_turned_by_a_full_turn_does_not_move_at_activation(way: int) -> None:
    bench = Bench().configured()
    turned_once_round(bench, way)
    before = shaft_counts(bench)
    bench.hardware.activate()
    state = bench.hardware.read()
    for _ in range(20):
        bench.hardware.write(JointCommand(state.position, PERIOD_S))
        bench.clock.sleep_until(bench.clock.now() + PERIOD_S)
        bench.hardware.read()
    assert shaft_counts(bench) == pytest.approx(before, abs=1.5)


def test_a_lost_instruction_to_forget_turns_is_repeated() -> None:
    bench = Bench().configured()
    turned_once_round(bench)
    before = shaft_counts(bench)
    bench.servos.faults.corrupt_next(ELBOW, 2)
    bench.hardware.activate()
    bench.clock.sleep_until(bench.clock.now() + 1.0)
    bench.hardware.read()
    assert shaft_counts(bench) == pytest.approx(before, abs=1.5)


def lacks_the_instruction(monkeypatch: pytest.MonkeyPatch) -> None:
    def silent(self: SingleServo, servo_id: int) -> None:
        raise ServoSilent(servo_id, "does not respond: check its power and cable")

    monkeypatch.setattr(SingleServo, "forget_turns", silent)


def test_a_bus_without_the_instruction_to_forget_turns_is_accepted(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    lacks_the_instruction(monkeypatch)
    bench = Bench().configured()
    bench.hardware.activate()
    assert caplog.messages == [
        "shoulder (servo 1), elbow (servo 2), finger (servo 7) do not support the instruction 0x0A (forget turns): "
        "continuing without it"
    ]


def test_a_joint_that_passes_its_last_count_needs_the_instruction(monkeypatch: pytest.MonkeyPatch) -> None:
    lacks_the_instruction(monkeypatch)
    bench = Bench().configured()
    assert bench.hardware._buses is not None
    bus = bench.hardware._buses.buses[""]
    lacks = r"^servo 2: does not support the instruction 0x0A .* use an adapter that forwards the instruction$"
    with pytest.raises(ServoRefused, match=lacks):
        forget_turns(replace(JOINTS[1], seam_inside=True), FaultLog(), bus)


def test_a_reading_in_another_turn_is_explained() -> None:
    assert counted_turns(JOINTS[1], 6144) == (
        "The servo reports 6144 counts, which is outside 0 to 4095: it has counted a turn. Hold the arm, and switch "
        "the servos' supply off and on. Do not change zero_counts, because the new value would be wrong afterwards"
    )
    assert "it has counted 2 turns" in counted_turns(JOINTS[1], -5000)
    assert counted_turns(JOINTS[1], 4095) == counted_turns(JOINTS[1], 0) == ""


def test_a_servo_held_in_another_turn_is_refused_and_keeps_holding() -> None:
    bench = Bench().configured()
    servo = bench.servos.servo(ELBOW)
    turned_once_round(bench)
    for register in (sts.min_position, sts.max_position):
        servo.memory.put(register, 0)  # several turns
    servo.memory.put(sts.goal_position, 2000 + TURN)
    servo.firmware.note_write(sts.goal_position.address, 2)
    servo.memory.put(sts.torque_enable, 1)
    bench.clock.sleep_until(bench.clock.now() + 0.2)
    before = shaft_counts(bench)
    message = (
        r"elbow \(servo 2\) has goal 6096 but reports \d+ counts: it is in a different turn, or another program "
        r"enabled its torque without a goal\. Hold the arm, and switch the servos' supply off and on$"
    )
    with pytest.raises(ActivationError, match=message):
        bench.hardware.activate()
    bench.clock.sleep_until(bench.clock.now() + 1.0)
    bench.hardware.read()
    assert shaft_counts(bench) == pytest.approx(before, abs=2.5)
    assert bench.torque() == [ELBOW]


@pytest.mark.parametrize("way", [TURN // 2, -TURN // 2])
@pytest.mark.parametrize("further", [0, 1])
def test_a_servo_with_torque_may_be_at_most_half_a_turn_from_its_goal(way: int, further: int) -> None:
    middle = 2048
    bench = Bench(counts=(middle, 2000, 1500)).configured()
    memory = bench.servos.servo(1).memory
    memory.put(
        sts.goal_position, middle + way + int(math.copysign(further, way))
    )  # set directly, because a write would change the position
    memory.put(sts.torque_enable, 1)
    if not further:
        bench.hardware.activate()
        assert bench.held(1, sts.goal_position) == middle
        return
    with pytest.raises(ActivationError, match=r"shoulder \(servo 1\) has goal -?\d+ but reports 2048 counts"):
        bench.hardware.activate()
