"""Dynamixel packets: examples of the e-manual, packets of the official SDK, and robustness of the decoder."""

import importlib
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest
from fastcrc.crc16 import umts as crc16
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.protocol import v2 as wire
from drivers.protocol.decoder import Reply
from drivers.servos import x as x_series
from drivers.servos.x import XL430_W250
from drivers.types import ServoGoal
from sim_backend.clock import SimulatedClock
from sim_backend.packets.dynamixel import InstructionParser, status_packet
from tests.drivers.tape import SdkPackets, Tape

# The module is imported by name, because it has no types.
sdk: Any = importlib.import_module("dynamixel_sdk")
SDK = SdkPackets(sdk, sdk.PacketHandler(2.0))

PATTERN = b"\xff\xff\xfd"
ids = st.lists(st.integers(0, wire.LARGEST_ID), min_size=1, max_size=20, unique=True)
addresses = st.integers(0, 0xFFFF)


@pytest.mark.parametrize(
    ("packet", "says"),
    [
        (wire.packet(1, 0x01, b""), "fffffd00 01 0300 01 194e"),
        (wire.packet(1, wire.READ, wire.span(132, 4)), "fffffd00 01 0700 02 84000400 1d15"),
        (wire.packet(1, wire.WRITE, bytes.fromhex("7400 00020000")), "fffffd00 01 0900 03 740000020000 ca89"),
        (wire.sync_read((1, 2), 132, 4), "fffffd00 fe 0900 82 840004000102 cefa"),
        (
            wire.sync_write(116, 4, b"\x01\x96\0\0\0\x02\xaa\0\0\0"),
            "fffffd00 fe 1100 83 74000400 0196000000 02aa000000 8287",
        ),
        (status_packet(1, 0, b"\xa6\0\0\0"), "fffffd00 01 0800 55 00 a6000000 8cc0"),
        (status_packet(2, 0, b"\x1f\x08\0\0"), "fffffd00 02 0800 55 00 1f080000 babe"),
    ],
)
def test_the_examples_of_the_manual(packet: bytes, says: str) -> None:
    assert packet == bytes.fromhex(says)


@given(st.binary(max_size=60))
def test_the_checksum_equals_that_of_the_sdk(data: bytes) -> None:
    assert crc16(data) == sdk.PacketHandler(2.0).updateCRC(0, list(data), len(data))


@given(ids, addresses, st.integers(1, 0xFFFF))
def test_sync_reads_equal_those_of_the_sdk(servo_ids: list[int], address: int, size: int) -> None:
    ours = wire.sync_read(servo_ids, address, size)
    if PATTERN not in ours[3:]:  # the SDK computes the stuffing but sends the packet without it
        assert ours == SDK.sync_read(servo_ids, address, size)


@given(ids, addresses, st.integers(1, 10), st.data())
def test_sync_writes_equal_those_of_the_sdk(servo_ids: list[int], address: int, size: int, data: st.DataObject) -> None:
    contents = {i: data.draw(st.binary(min_size=size, max_size=size)) for i in servo_ids}
    ours = wire.sync_write(address, size, b"".join(bytes((i,)) + data for i, data in contents.items()))
    if PATTERN not in ours[3:]:
        assert ours == SDK.sync_write(address, size, contents)


@given(st.lists(st.sampled_from([b"\xff", b"\xfd", b"\x00", b"\x01"]), max_size=40).map(b"".join))
def test_byte_stuffing_equals_that_of_the_sdk(parameters: bytes) -> None:
    plain = [*wire.HEADER, 1, *(len(parameters) + 3).to_bytes(2, "little"), wire.WRITE, *parameters, 0, 0]
    stuffed = bytes(sdk.PacketHandler(2.0).addStuffing(plain))
    ours = wire.packet(1, wire.WRITE, parameters)
    assert ours[:-2] == stuffed[:-2]
    assert PATTERN + b"\x00" not in ours[1:-2]
    (instruction,) = InstructionParser().feed(ours)
    assert instruction.parameters == parameters


@given(st.dictionaries(st.integers(0, 252), st.tuples(st.integers(0, 4095), st.integers(0, 10000)), max_size=20))
def test_goals_equal_those_of_the_sdk(goals: dict[int, tuple[int, int]]) -> None:
    tape = Tape()
    bus = Bus(tape, SimulatedClock(), {1: XL430_W250})
    bus.write_goals({i: ServoGoal(position, velocity) for i, (position, velocity) in goals.items()})
    contents = {}
    for i, (position, velocity) in goals.items():
        units = -(-velocity * 60_000 // (229 * 4096))
        contents[i] = units.to_bytes(4, "little") + position.to_bytes(4, "little")
    if contents:
        assert tape.sent == SDK.sync_write(112, 8, contents)


@given(ids)
def test_state_requests_equal_those_of_the_sdk(servo_ids: list[int]) -> None:
    tape = Tape()
    Bus(tape, SimulatedClock(), {1: XL430_W250}).read_states(servo_ids[:1])
    assert tape.sent == SDK.sync_read(servo_ids[:1], x_series.present_pwm.address, 23)


def pieces(data: bytes, cuts: Sequence[int]) -> list[bytes]:
    """Return ``data`` split at these positions."""
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


likely = st.lists(st.sampled_from([b"\xff", b"\xfd", b"\x00", b"\x55", b"\x0c", wire.HEADER]), max_size=30).map(
    b"".join
)
noise = st.one_of(st.binary(max_size=60), likely)


@given(noise, st.integers(0, 252), st.integers(0, 255), likely | st.binary(min_size=8, max_size=8), st.data())
def test_a_reply_after_noise_is_found(
    before: bytes, servo_id: int, error: int, content: bytes, data: st.DataObject
) -> None:
    content = content[:8].ljust(8, b"\xfd")
    decoder = wire.ReplyDecoder(8)
    stream = before + status_packet(servo_id, error, content) + bytes(40)
    found = [
        reply
        for piece in pieces(stream, data.draw(st.lists(st.integers(0, 200), max_size=6)))
        for reply in decoder.feed(piece)
    ]
    assert Reply(servo_id, error, content) in found


@given(st.lists(noise, max_size=8))
def test_noise_is_not_a_reply(chunks: list[bytes]) -> None:
    decoder = wire.ReplyDecoder(4)
    for chunk in chunks:
        assert decoder.feed(chunk) == []


@given(st.binary(min_size=6, max_size=6), st.integers(0, 8 * 17 - 1))
def test_a_reply_with_a_flipped_bit_is_not_accepted(content: bytes, bit: int) -> None:
    frame = bytearray(status_packet(3, 0, content))
    if len(frame) != 17:
        return
    frame[bit // 8] ^= 1 << bit % 8
    decoder = wire.ReplyDecoder(6)
    assert decoder.feed(bytes(frame) + bytes(40)) == []
    if bit // 8 >= 7 + 1:
        assert decoder.corrupt_ids == [3]


@pytest.mark.parametrize("size", [3, 5])
def test_a_reply_of_a_different_size_is_skipped(size: int) -> None:
    decoder = wire.ReplyDecoder(4)
    good = status_packet(2, 0, b"good")
    assert decoder.feed(status_packet(1, 0, bytes(size)) + good) == [Reply(2, 0, b"good")]


@pytest.mark.parametrize("size", [0, 1, 247, 248, 251, 300, 1000])
def test_data_of_any_length_are_extracted_from_the_sdks_reply(size: int) -> None:
    """The length has two bytes. The SDK returns the packet as a list of numbers without byte stuffing."""
    data = bytes(number % 251 for number in range(size))
    assert wire.sdk_data(list(status_packet(3, 0, data))) == data
