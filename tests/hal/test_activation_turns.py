"""A servo that counts its shaft's turns: what it reports is a place within one turn, what it drives to is not."""

import math
from dataclasses import replace

import pytest

from drivers.bus.single_servo import SingleServo
from drivers.errors import ServoRefused, ServoSilent
from drivers.servos import sts
from hal.errors import ActivationError
from hal.servos.activation import counted_turns
from hal.servos.fault_log import FaultLog
from hal.servos.servo_setup import forget_turns
from hal.types import JointCommand
from tests.hal.bench import JOINTS, PERIOD_S, Bench

TURN = 4096
ELBOW = 2


def turned_once_round(bench: Bench, way: int = 1) -> None:
    """The elbow is turned by hand, from where it stands over the seam to there again."""
    for step in range(1, 65):
        elbow = 2000 + way * step * TURN // 64
        bench.plant.place([(counts + 0.5) / TURN * math.tau for counts in (2048, elbow, 1500)])
        bench.clock.sleep_until(bench.clock.now() + 0.005)
        bench.servos.advance(bench.clock.now())


def shaft_counts(bench: Bench) -> list[float]:
    return [angle / math.tau * TURN for angle in bench.plant.joints.position]


@pytest.mark.parametrize("way", [1, -1])
def test_a_limp_servo_that_was_turned_once_round_stays_where_it_is(way: int) -> None:
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


def test_the_order_to_forget_its_turns_is_given_again_where_it_is_lost() -> None:
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
        raise ServoSilent(servo_id, "does not answer: check its power and cable")

    monkeypatch.setattr(SingleServo, "forget_turns", silent)


def test_a_bus_that_lacks_the_order_to_forget_turns_is_gone_on_with(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    lacks_the_instruction(monkeypatch)
    bench = Bench().configured()
    bench.hardware.activate()
    assert caplog.messages == [
        "shoulder (servo 1), elbow (servo 2), finger (servo 7) do not support the instruction 0x0A (forget turns): "
        "continuing without it"
    ]


def test_a_joint_that_passes_the_end_of_its_counts_needs_the_order(monkeypatch: pytest.MonkeyPatch) -> None:
    lacks_the_instruction(monkeypatch)
    bench = Bench().configured()
    assert bench.hardware._buses is not None
    bus = bench.hardware._buses.buses[""]
    with pytest.raises(ServoRefused, match="does not support the instruction 0x0A"):
        forget_turns(replace(JOINTS[1], seam_inside=True), FaultLog(), bus)


def test_a_reading_a_turn_away_is_told_as_such() -> None:
    assert "it has counted a turn" in counted_turns(JOINTS[1], 6144)
    assert "it has counted 2 turns" in counted_turns(JOINTS[1], -5000)
    assert counted_turns(JOINTS[1], 4095) == counted_turns(JOINTS[1], 0) == ""


def test_a_servo_that_another_program_holds_a_turn_away_is_refused_and_goes_on_holding() -> None:
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
    says = (
        r"elbow \(servo 2\) has goal 6096 but reports \d+ counts, so it is probably "
        r"held in another turn\. Hold the arm, and switch the servos' supply off and on$"
    )
    with pytest.raises(ActivationError, match=says):
        bench.hardware.activate()
    bench.clock.sleep_until(bench.clock.now() + 1.0)
    bench.hardware.read()
    assert shaft_counts(bench) == pytest.approx(before, abs=2.5)
    assert bench.torque() == [ELBOW]


@pytest.mark.parametrize("way", [TURN // 2, -TURN // 2])
@pytest.mark.parametrize("further", [0, 1])
def test_a_servo_under_torque_may_be_half_a_turn_from_its_goal_and_no_further(way: int, further: int) -> None:
    middle = 2048
    bench = Bench(counts=(middle, 2000, 1500)).configured()
    memory = bench.servos.servo(1).memory
    memory.put(sts.goal_position, middle + way + int(math.copysign(further, way)))  # not by a write: it stays
    memory.put(sts.torque_enable, 1)
    if not further:
        bench.hardware.activate()
        assert bench.held(1, sts.goal_position) == middle
        return
    with pytest.raises(ActivationError, match=r"shoulder \(servo 1\) has goal -?\d+ but reports 2048 counts"):
        bench.hardware.activate()
