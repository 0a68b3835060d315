"""Faults specific to the STS bus: late replies recognized by their length, and the fast encoder and decoder."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.known_servos import KnownServos
from drivers.protocol import v1 as wire
from drivers.protocol.decoder import Reply
from drivers.servos import sts
from drivers.servos.feetech import STS
from drivers.types import ServoGoal, ServoState
from tests.drivers.fault_lines import IDS
from tests.drivers.tape import one_bit_flipped


def state(servo_id: int, status: int, data: bytes) -> ServoState:
    """Decode a single reply."""
    result = KnownServos({}).plan((servo_id,)).result(Reply(servo_id, status, data))
    assert isinstance(result, ServoState)
    return result


def test_reply_lengths_differ_in_more_than_one_bit() -> None:
    sizes = [block.size for block in STS.blocks]
    assert sizes[0] == sum(register.size for register in sts.STATE_BLOCK) and all(a < b for a, b in pairwise(sizes))
    lengths = [size + 2 for size in sizes]
    assert all((a ^ b).bit_count() >= 2 for a in lengths for b in lengths if a != b)


def test_both_decoders_agree_and_detect_every_flipped_bit() -> None:
    frames = [wire.packet(i, i, bytes((i * 30 & 255, 0x80 | i, 9, 0x80, 0xF4, 5 + i, 118, 41))) for i in IDS]
    whole = KnownServos({}).plan(IDS).decode_all
    replies = wire.ReplyDecoder(8).feed(b"".join(frames))
    assert whole(b"".join(frames)) == {r.servo_id: state(r.servo_id, r.error, r.data) for r in replies}
    assert all(whole(flipped) is None for flipped in one_bit_flipped(b"".join(frames)))


# Both signs of all fields, and values that look like the sign of another field.
signed_words = st.one_of(st.integers(-0x7FFF, 0x7FFF), st.sampled_from((-0x7FFF, -1, 0, 1, 0x400, 0x7FFF)))
some_ids = st.lists(st.integers(0, 0xFD), min_size=1, max_size=12, unique=True).map(tuple)


@given(some_ids, st.data())
def test_replies_decoded_together_and_separately_agree(servo_ids: tuple[int, ...], draw: st.DataObject) -> None:
    blocks = {i: draw.draw(st.tuples(st.integers(0, 255), st.binary(min_size=8, max_size=8))) for i in servo_ids}
    data = b"".join(wire.packet(servo_id, status, block) for servo_id, (status, block) in blocks.items())
    expected = {servo_id: state(servo_id, status, block) for servo_id, (status, block) in blocks.items()}
    assert KnownServos({}).plan(servo_ids).decode_all(data) == expected
    assert [bool(one.alarms) for one in expected.values()] == [status != 0 for status, _ in blocks.values()]


@given(st.dictionaries(st.integers(0, 0xFD), st.tuples(signed_words, st.integers(0, 0x7FFF)), min_size=1, max_size=12))
def test_goals_are_encoded_as_their_registers_define(numbers: dict[int, tuple[int, int]]) -> None:
    expected = {}
    for servo_id, (position, velocity) in numbers.items():
        values = {
            sts.acceleration: sts.GOAL_ACCELERATION,
            sts.goal_position: position,
            sts.goal_velocity: velocity,
        }
        expected[servo_id] = b"".join(register.encode(values.get(register, 0), "little") for register in sts.GOAL_BLOCK)
    packet = KnownServos({}).goals({i: ServoGoal(*both) for i, both in numbers.items()})
    entries = b"".join(bytes((servo_id,)) + data for servo_id, data in expected.items())
    assert packet == wire.sync_write(sts.acceleration.address, 7, entries)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        *((ServoGoal(wrong), "goal_position must be") for wrong in (0x8000, -0x8000, 1 << 32, -(1 << 48))),
        *((ServoGoal(0, wrong), "goal_velocity must be") for wrong in (0x8000, 1 << 32)),
        *((ServoGoal(0, wrong), "velocity must be 0 or more") for wrong in (-1, -0x8000, -(1 << 48))),
    ],
)
def test_a_goal_that_does_not_fit_is_refused_among_others(wrong: ServoGoal, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        KnownServos({}).goals({1: ServoGoal(5, 5), 2: wrong, 3: ServoGoal(-5)})
