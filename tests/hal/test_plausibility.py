"""Tests of the plausibility check: reachable and confirmed position readings are accepted."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.leaps import OVERSPEED, Plausibility
from sim_backend.servos.generic.packet_servo import WiredServo
from tests.hal.bench import JOINTS, PERIOD_S, Bench, at

SHOULDER = JOINTS[0]
FAST = OVERSPEED * SHOULDER.model.no_load_speed_rad_s
HERE = at(0.0, 0.0, 0.014)


def followed(*positions: float, period_s: float = PERIOD_S) -> list[bool]:
    """Return, for each reading of a driven joint, whether it is accepted."""
    readings = Plausibility.of_servo(SHOULDER)
    return [readings.leap(position, 10.0 + n * period_s, True) is None for n, position in enumerate(positions)]


@given(st.lists(st.floats(-FAST, FAST), max_size=30), st.floats(0.002, 0.2))
def test_every_motion_that_a_servo_can_make_is_accepted(speeds: list[float], period_s: float) -> None:
    positions = [0.0]
    for speed in speeds:
        positions.append(positions[-1] + speed * period_s)
    assert all(followed(*positions, period_s=period_s))


@given(st.floats(-1.0, 1.0), st.floats(1.3, 6.0), st.sampled_from((1, -1)))
def test_a_jump_is_accepted_once_it_is_confirmed(start: float, away: float, side: int) -> None:
    there = start + side * away
    assert followed(start, there, start, there, start) == [True, False, True, False, True]
    assert followed(start, there, there, there) == [True, False, True, True]


def test_after_a_long_silence_a_distant_position_must_be_confirmed() -> None:
    readings = Plausibility.of_servo(SHOULDER)
    assert readings.leap(0.0, 10.0, True) is None
    assert readings.leap(3.0, 20.0, True) == pytest.approx(3.0)
    assert readings.leap(3.0, 20.05, True) is None


def deceive(servo: WiredServo, counts: int) -> None:
    """Make the next position reply of a servo report a false position."""

    def falsify(address: int, size: int, data: bytes) -> bytes:
        if not address <= servo.PRESENT_POSITION.address < address + size:
            return data
        servo.on_read.remove(falsify)
        at = servo.PRESENT_POSITION.address - address
        false = int.from_bytes(data[at : at + 2], "little") + counts
        return data[:at] + false.to_bytes(2, "little") + data[at + 2 :]

    servo.on_read.append(falsify)


def test_a_false_reading_is_a_fault_of_its_joint_only_and_is_counted() -> None:
    bench = Bench().active()
    before = bench.cycle(HERE)
    deceive(bench.servos.servo(1), 1000)
    state = bench.cycle(HERE)
    assert {joint: fault.kind for joint, fault in state.faults.items()} == {"shoulder": "implausible"}
    assert state.faults["shoulder"].text == (
        "shoulder: servo 1 reports 3048 counts, +1.5340 from the previous reading. No joint moves that fast, so the "
        "position is ignored until a second reading confirms it"
    )
    assert state.position[0] == before.position[0]
    counters = state.health["shoulder"].counters
    assert counters is not None and counters.implausible == 1
    state = bench.cycle(HERE)
    assert not state.faults and state.position[0] == pytest.approx(0.0, abs=0.01)
    assert bench.measured(1) == pytest.approx(2048, abs=6)


def test_a_seam_inside_the_limits_is_not_a_jump_but_one_outside_is() -> None:
    turn = SHOULDER.model.counts_per_turn * abs(SHOULDER.units_per_count)
    across = [0.5 * turn - 0.01, -0.5 * turn + 0.01, 0.5 * turn - 0.02]
    for inside in (True, False):
        readings = Plausibility.of_servo(replace(SHOULDER, seam_inside=inside))
        believed = [readings.leap(position, 10.0 + n * PERIOD_S, True) is None for n, position in enumerate(across)]
        assert believed == [True, inside, True]
    readings = Plausibility.of_servo(replace(SHOULDER, seam_inside=True))
    assert readings.leap(0.0, 10.0, True) is None
    assert readings.leap(2.0, 10.0 + PERIOD_S, True) == pytest.approx(2.0), "less than a turn is also a jump"
