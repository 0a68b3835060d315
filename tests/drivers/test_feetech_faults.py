"""What is the STS bus's own against faults: late replies known by their length, and a way to decode whole bursts."""

from collections import Counter
from itertools import pairwise

from drivers.feetech import state, wire
from tests.drivers.fault_lines import IDS


def test_lengths_that_tell_late_replies_survive_a_flipped_bit() -> None:
    sizes = state.STATE_SIZES
    assert sizes[0] == state.STATE_SIZE and all(a < b for a, b in pairwise(sizes))
    lengths = [size + 2 for size in sizes]
    assert all((a ^ b).bit_count() >= 2 for a in lengths for b in lengths if a != b)


def test_fast_and_slow_ways_give_the_same_states_and_no_flipped_bit_passes() -> None:
    frames = [wire.packet(i, i, bytes((i * 30 & 255, 0x80 | i, 9, 0x80, 0xF4, 5 + i, 118, 41))) for i in IDS]
    fast = state.burst(b"".join(frames), IDS, state.STATE_SIZE)
    replies = wire.ReplyDecoder(state.STATE_SIZE).feed(b"".join(frames))
    assert fast == {r.servo_id: state.state(r.status, r.data) for r in replies}
    spoiled = bytearray(b"".join(frames))
    counts: Counter[bool] = Counter()
    for bit in range(len(spoiled) * 8):
        spoiled[bit // 8] ^= 1 << bit % 8
        counts[state.burst(bytes(spoiled), IDS, state.STATE_SIZE) is None] += 1
        spoiled[bit // 8] ^= 1 << bit % 8
    assert counts == {True: len(spoiled) * 8}
