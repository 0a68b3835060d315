"""Properties of the position calculations over all counts, offsets and turns, also compared with the virtual servo."""

from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.eeprom import update
from drivers.servos import angles, sts
from drivers.servos.angles import LARGEST_OFFSET, TURN, Travel
from drivers.servos.register import ByteOrder
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant

counts = st.integers(0, TURN - 1)
turns = st.integers(-7 * TURN, 7 * TURN)
offsets = st.integers(-LARGEST_OFFSET, LARGEST_OFFSET)
signed = st.sampled_from([r for r in sts.REGISTERS if r.sign_bit is not None])


@given(signed, st.sampled_from(("little", "big")), st.data())
def test_the_sign_is_one_bit_up_to_both_limits(register: object, order: ByteOrder, data: st.DataObject) -> None:
    assert isinstance(register, type(sts.homing_offset)) and register.sign_bit is not None
    limit = (1 << register.sign_bit) - 1
    value = data.draw(st.one_of(st.integers(-limit, limit), st.sampled_from((-limit, -1, 0, 1, limit))))
    raw = int.from_bytes(register.encode(value, order), order)
    assert raw & limit == abs(value)
    assert raw >> register.sign_bit == (value < 0)
    assert register.decode(register.encode(value, order), order) == value
    with pytest.raises(ValueError, match="nothing was written"):
        register.encode(limit + 1 if value >= 0 else -limit - 1, order)


@given(turns, turns)
def test_the_shortest_distance_reaches_the_end_within_half_a_turn(start: int, end: int) -> None:
    way = angles.shortest(start, end)
    assert (start + way - end) % TURN == 0
    assert -TURN // 2 <= way < TURN // 2


@given(turns, turns, turns)
def test_the_offset_fits_the_register_and_gives_the_wanted_reading(actual: int, wanted: int, old: int) -> None:
    offset = angles.offset_for(actual, wanted)
    sts.homing_offset.encode(offset, "little")
    missed = angles.shortest(wanted, angles.reading_of(actual, offset))
    assert missed == (-1 if angles.shortest(wanted, actual) == -TURN // 2 else 0)
    assert angles.new_offset(actual - old, old, wanted) == offset


@given(turns, offsets)
def test_reading_and_actual_position_are_inverse_functions(actual: int, offset: int) -> None:
    assert angles.actual_of(angles.reading_of(actual, offset), offset) == actual % TURN


@given(counts, st.integers(0, TURN - 2) | st.just(TURN - 2), offsets)
def test_the_new_offset_keeps_the_wrap_outside_the_travel(lower: int, span: int, offset: int) -> None:
    begin = angles.reading_of(lower, offset)
    new = angles.offset_for_travel(Travel(begin, begin + span), offset)
    sts.homing_offset.encode(new, "little")
    there = angles.moved(Travel(begin, begin + span), offset, new)
    assert 0 <= there.lower <= there.upper < TURN
    middle = (there.lower + there.upper) // 2
    assert middle == TURN // 2 or (middle, new) == (TURN // 2 - 1, -LARGEST_OFFSET)
    assert (there.lower, there.upper) == (angles.reading_of(lower, new), angles.reading_of(lower + span, new))


@given(turns, st.integers(TURN - 1, 3 * TURN), offsets)
def test_a_travel_that_fills_the_turn_is_refused(lower: int, span: int, offset: int) -> None:
    with pytest.raises(ValueError, match="the wrap must be outside it"):
        angles.offset_for_travel(Travel(lower, lower + span), offset)


@settings(max_examples=40)
@given(counts, offsets, counts)
def test_the_virtual_servo_agrees(actual: int, old: int, wanted: int) -> None:
    """Write an offset and read the position, then calculate a new offset from the reading and read again."""
    plant = BenchPlant((1,))
    plant.place([(actual + 0.5) * 2.0 * pi / TURN])
    clock = SimulatedClock(0.0)
    bus = Bus(VirtualPort(VirtualBus.of(plant), clock), clock)

    def position(offset: int) -> int:
        update(bus, 1, sts.lock, {sts.homing_offset: offset})
        clock.sleep_until(clock.now() + 0.01)
        return bus.read(1, sts.present_position)

    first = position(old)
    assert first == angles.reading_of(actual, old)
    offset = angles.new_offset(first, old, wanted)
    assert position(offset) == angles.reading_of(actual, offset)
    assert abs(angles.shortest(wanted, angles.reading_of(actual, offset))) <= 1
