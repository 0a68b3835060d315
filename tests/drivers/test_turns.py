"""Servos in extended position mode: the bus removes whole turns from their positions."""

import pytest

from drivers.bus.bus import Bus
from drivers.bus.turns import Turns
from drivers.servos import x
from drivers.types import ServoGoal, ServoState, fault
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant


def at(counts: int) -> ServoState:
    return ServoState(counts, 0, 0.0, 12.0, 30.0, ())


@pytest.mark.parametrize(("counts", "place"), [(4095, 4095), (4096, 0), (-1, 4095), (-9000, 3288), (100, 100)])
def test_whole_turns_are_subtracted_from_positions_and_added_to_goals(counts: int, place: int) -> None:
    turns = Turns()
    turns.identified(1, x.XL430_W250, extended=True)
    turns.identified(2, x.XL430_W250, extended=False)
    silent = fault(3, "silent")
    assert turns.readings({1: at(counts), 2: at(counts), 3: silent}) == {1: at(place), 2: at(counts), 3: silent}
    goals = turns.goals({1: ServoGoal(place + 5, 40), 2: ServoGoal(7)})
    assert goals == {1: ServoGoal(counts + 5, 40), 2: ServoGoal(7)}
    assert turns.goal(1, counts) == place and turns.goal(2, counts) == counts
    assert 1 in turns and 2 not in turns


def test_positions_are_unchanged_after_extended_position_mode_ends() -> None:
    turns = Turns()
    turns.identified(1, x.XL430_W250, extended=True)
    turns.readings({1: at(5000)})
    turns.identified(1, x.XL430_W250, extended=False)
    assert turns.readings({1: at(5000)}) == {1: at(5000)} and turns.goal(1, 5000) == 5000


def test_one_false_reading_does_not_shift_goals_by_a_turn() -> None:
    turns = Turns()
    turns.identified(1, x.XL430_W250, extended=True)
    turns.readings({1: at(100)})
    for false in (100 + 4096, 100 - 8192):
        assert turns.readings({1: at(false)}) == {1: at(false)}, "a leap that the next layer must see"
        assert turns.goals({1: ServoGoal(105)}) == {1: ServoGoal(105)}
        assert turns.readings({1: at(101)}) == {1: at(101)}
    turns.readings({1: at(4200)})
    assert turns.readings({1: at(4201)}) == {1: at(105)}, "the second reading confirms it"
    assert turns.goals({1: ServoGoal(110)}) == {1: ServoGoal(4206)}


def test_a_servo_that_restarts_in_a_different_turn_reaches_the_same_positions() -> None:
    clock, model = SimulatedClock(), x.XL430_W250
    line = VirtualDynamixelBus.of(BenchPlant((1,)), {1: model})
    servo = line.servo(1)
    servo.memory.save(x.operating_mode, x.EXTENDED_POSITION_MODE)
    servo.memory.save(x.homing_offset, -2000)
    servo.power_cycle()
    bus = Bus(VirtualPort(line, clock), clock, {1: model})
    bus.identify(1, model)
    assert bus.position_limits(1) is None

    def position() -> int:
        reading = bus.read_states([1])[1]
        assert isinstance(reading, ServoState)
        return reading.position_counts

    def go(counts: int) -> None:
        bus.write_goals({1: ServoGoal(counts)})
        assert bus.goal(1) == counts
        clock.sleep_until(clock.now() + 3.0)
        assert position() == pytest.approx(counts, abs=10)

    assert position() == 48
    bus.torque_on(1)
    go(2500)
    servo.power_cycle()
    assert bus.read_states([1])[1].kind == "reset"  # type: ignore[union-attr]
    assert position() == pytest.approx(2500, abs=10)
    assert servo.memory.get(x.present_position) == pytest.approx(2500 - 4096, abs=10), "it counts from another turn now"
    bus.torque_on(1)
    go(3000)
    go(60)


@pytest.mark.parametrize(("start", "end", "step"), [(4000, 4500, 30), (90, -400, -30), (8000, 8600, 30)])
def test_a_servo_that_is_pushed_past_the_end_of_its_turn_stays_in_its_turn(start: int, end: int, step: int) -> None:
    turns = Turns()
    turns.identified(1, x.XL430_W250, extended=True)
    whole_turns = start // 4096 * 4096
    for counts in (*range(start, end, step), end, end, *range(end, start, -step)):
        assert turns.readings({1: at(counts)}) == {1: at(counts - whole_turns)}
        assert turns.goals({1: ServoGoal(3000)}) == {1: ServoGoal(3000 + whole_turns)}


def test_a_long_motion_during_a_silence_keeps_the_turn() -> None:
    turns = Turns()
    turns.identified(1, x.XL430_W250, extended=True)
    for counts in (100, 4000, 50):
        assert turns.readings({1: at(counts)}) == {1: at(counts)}
        turns.readings({1: fault(1, "silent")})


@pytest.mark.parametrize(
    ("goal", "counts", "place"),
    [(3982, 4102, 4102), (4200, 4000, -96), (3982 + 4096, 4102 + 4096, 4102), (3000, 3000, 3000)],
)
def test_a_servo_with_torque_is_in_the_turn_of_its_goal(goal: int, counts: int, place: int) -> None:
    turns = Turns()
    turns.identified(1, x.XL430_W250, extended=True, held=goal)
    assert turns.readings({1: at(counts)}) == {1: at(place)}
    assert turns.goal(1, goal) == goal % 4096
    turns.identified(1, x.XL430_W250, extended=True)
    assert turns.readings({1: at(counts)}) == {1: at(counts % 4096)}, "a limp servo may have been turned by hand"
