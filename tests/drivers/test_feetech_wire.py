"""Packets and the decoder: whatever happens to the bytes, the decoder returns no false reply and loses no valid
reply."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.protocol import v1 as wire
from drivers.protocol.decoder import Reply
from drivers.protocol.v1 import ReplyDecoder

DATA_SIZE = 8
FRAME_SIZE = DATA_SIZE + wire.OVERHEAD


def frame(servo_id: int, data: bytes, status: int = 0) -> bytes:
    """Return a status packet encoded according to the manual, without the code under test."""
    length = len(data) + 2
    checksum = 255 - (servo_id + length + status + sum(data)) % 256
    return bytes((0xFF, 0xFF, servo_id, length, status, *data, checksum))


def replies_in(stream: bytes) -> list[Reply]:
    """Return the replies that a search at every position of the whole stream finds."""
    found: list[Reply] = []
    at = 0
    while at + FRAME_SIZE <= len(stream):
        part = stream[at : at + FRAME_SIZE]
        data = part[5:-1]
        whole = b"\xff\xff" not in part[2:]  # otherwise another frame begins within this one
        if whole and part[2] <= 0xFD and part == frame(part[2], data, part[4]):
            found.append(Reply(part[2], part[4], data))
            at += FRAME_SIZE
        else:
            at += 1
    return found


def decode(pieces: list[bytes]) -> list[Reply]:
    decoder = ReplyDecoder(DATA_SIZE)
    return [reply for piece in pieces for reply in decoder.feed(piece)]


def split(stream: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(stream) + 1) for cut in cuts), len(stream)]
    return [stream[a:b] for a, b in pairwise(edges)]


servo_ids = st.integers(0, 0xFD)
payloads = st.binary(min_size=DATA_SIZE, max_size=DATA_SIZE)
# Bytes that look like parts of a frame are the hardest for a decoder.
tricky = st.sampled_from((0xFF, 0xFF, 0xFF, DATA_SIZE + 2, 1, 0, 0xFE))
tricky_bytes = st.lists(st.one_of(tricky, st.integers(0, 255)), max_size=40).map(bytes)
good_frames = st.builds(frame, servo_ids, st.one_of(payloads, st.just(b"\xff" * DATA_SIZE)), st.integers(0, 127))
streams = st.lists(st.one_of(good_frames, tricky_bytes), max_size=6).map(b"".join)
all_cuts = st.lists(st.integers(0, 1000), max_size=12)


@pytest.mark.parametrize(
    ("made", "wanted"),
    [
        (wire.packet(1, 0x01, b""), "ff ff 01 02 01 fb"),  # example of a ping in the manual
        (wire.packet(1, 0x02, b"\x38\x02"), "ff ff 01 04 02 38 02 be"),  # example of a read of a position in the manual
        (wire.sync_read([1, 2], 0x38, 8), "ff ff fe 06 82 38 08 01 02 36"),
        (
            wire.sync_write(0x2A, 2, b"\x01\x00\x08\x02\xff\x07"),
            "ff ff fe 0a 83 2a 02 01 00 08 02 ff 07 37",
        ),
    ],
)
def test_packets_byte_by_byte(made: bytes, wanted: str) -> None:
    assert made == bytes.fromhex(wanted)


@pytest.mark.parametrize("size", [2, 4, 6])
def test_more_goals_than_the_length_field_allows_are_refused(size: int) -> None:
    """The length field is one byte and counts all bytes after itself."""
    most = (255 - 4) // (size + 1)
    assert wire.sync_write(0x2A, size, bytes(size + 1) * most)[3] == most * (size + 1) + 4
    with pytest.raises(
        ValueError, match=f"^{most + 1} goals do not fit into a packet, which holds at most {most}: connect some"
    ):
        wire.sync_write(0x2A, size, bytes(size + 1) * (most + 1))


@pytest.mark.parametrize("size", [0, 1, 8, 200])
def test_data_of_any_length_are_extracted_from_the_sdks_reply(size: int) -> None:
    """The SDK returns the packet as a list of numbers."""
    data = bytes(range(size))
    assert wire.sdk_data(list(frame(3, data))) == data


def test_a_packet_may_have_the_maximum_length() -> None:
    assert wire.sync_write(0x2A, 250, bytes(251))[3] == 255


@pytest.mark.parametrize(
    ("name", "stream", "ids"),
    [
        ("nothing", b"", []),
        ("one frame", frame(1, bytes(8)), [1]),
        ("two frames", frame(1, bytes(8)) + frame(2, bytes(8)), [1, 2]),
        ("garbage before", b"\x00\x13\x37" + frame(1, bytes(8)), [1]),
        ("a lone ff before", b"\xff" + frame(1, bytes(8)), [1]),
        ("many ff before", b"\xff" * 9 + frame(1, bytes(8)), [1]),
        ("garbage between", frame(1, bytes(8)) + b"\xffx\xff\xff" + frame(2, bytes(8)), [1, 2]),
        ("a false header that promises a frame", b"\xff\xff\x07\x0a\x00" + frame(1, bytes(8)), [1]),
        ("a false header that promises 250 bytes", b"\xff\xff\x07\xfa\x00" + frame(1, bytes(8)), [1]),
        ("a torn frame", frame(1, bytes(8))[:9] + frame(2, bytes(8)), [2]),
        ("a frame of another size", frame(1, bytes(4)) + frame(2, bytes(8)), [2]),
        ("our own request as an echo", wire.sync_read([1, 2], 56, 8) + frame(1, bytes(8)), [1]),
        ("data full of headers", frame(1, b"\xff" * 8) + frame(2, b"\xff\xff\x01\x0a\x00\xff\xff\x02"), []),
        ("the broadcast id does not reply", frame(0xFE, bytes(8)), []),
        ("an incomplete frame", frame(1, bytes(8))[:-1], []),
    ],
)
def test_which_frames_are_found(name: str, stream: bytes, ids: list[int]) -> None:
    assert [reply.servo_id for reply in decode([stream])] == ids, name
    assert [reply.servo_id for reply in decode([bytes((b,)) for b in stream])] == ids, f"{name}, byte by byte"


def test_a_reply_has_status_and_data() -> None:
    assert decode([frame(7, b"abcdefgh", 0x21)]) == [Reply(7, 0x21, b"abcdefgh")]


def test_a_reply_with_a_wrong_checksum_is_reported_and_not_accepted() -> None:
    decoder = ReplyDecoder(DATA_SIZE)
    broken = frame(3, bytes(8))[:-1] + b"\x00"
    assert decoder.feed(broken + frame(4, bytes(8))) == [Reply(4, 0, bytes(8))]
    assert decoder.corrupt_ids == [3]


@given(streams, all_cuts)
def test_any_split_gives_the_same_replies(stream: bytes, cuts: list[int]) -> None:
    whole, pieces = ReplyDecoder(DATA_SIZE), ReplyDecoder(DATA_SIZE)
    expected = whole.feed(stream)
    assert [r for piece in split(stream, cuts) for r in pieces.feed(piece)] == expected
    assert pieces.corrupt_ids == whole.corrupt_ids


@given(streams, all_cuts)
def test_the_decoder_finds_the_same_replies_as_a_full_search(stream: bytes, cuts: list[int]) -> None:
    assert decode(split(stream, cuts)) == replies_in(stream)


@given(st.lists(st.tuples(st.binary(max_size=30), servo_ids, payloads), max_size=5), all_cuts)
def test_garbage_without_headers_costs_no_frame(pieces: list[tuple[bytes, int, bytes]], cuts: list[int]) -> None:
    clean = [(garbage.replace(b"\xff", b"\xfe"), servo_id, data) for garbage, servo_id, data in pieces]
    stream = b"".join(garbage + frame(servo_id, data) for garbage, servo_id, data in clean)
    assert decode(split(stream, cuts)) == [Reply(servo_id, 0, data) for _, servo_id, data in clean]


@given(servo_ids, payloads, st.integers(0, FRAME_SIZE - 1), st.integers(1, 255))
def test_a_reply_with_one_wrong_byte_is_never_accepted(servo_id: int, data: bytes, at: int, error: int) -> None:
    broken = bytearray(frame(servo_id, data))
    broken[at] ^= error
    assert decode([bytes(broken)]) == []


@given(tricky_bytes, servo_ids, payloads, all_cuts)
def test_a_later_valid_frame_is_found(garbage: bytes, servo_id: int, data: bytes, cuts: list[int]) -> None:
    """A false frame with a valid checksum may hide one valid frame, but not the frame after it."""
    silence = bytes(FRAME_SIZE)
    stream = garbage + silence + frame(servo_id, data)
    assert decode(split(stream, cuts))[-1] == Reply(servo_id, 0, data)


@given(st.lists(tricky_bytes, max_size=30))
def test_noise_is_not_kept_in_memory(noise: list[bytes]) -> None:
    decoder = ReplyDecoder(DATA_SIZE)
    for piece in noise:
        decoder.feed(piece)
    assert len(decoder._pending) < FRAME_SIZE
