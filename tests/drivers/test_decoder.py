"""Decoders of both protocols: garbage is counted, and only possible replies are returned."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.protocol import v1, v2
from sim_backend.packets.dynamixel import status_packet
from tests.drivers.test_feetech_wire import frame

SIZE = 6


@dataclass(frozen=True)
class Dialect:
    decoder: Callable[..., Any]
    reply: Callable[[int, bytes, int], bytes]
    """Encodes a reply from servo ID, data and error byte."""
    header: bytes
    false_header: bytes
    """Start of a reply of the right size whose remaining bytes never arrive."""


DIALECTS = {
    "protocol 1.0": Dialect(v1.ReplyDecoder, frame, b"\xff\xff", bytes((0xFF, 0xFF, 3, SIZE + 2))),
    "protocol 2.0": Dialect(
        v2.ReplyDecoder,
        lambda servo_id, data, error: status_packet(servo_id, error, data),
        v2.HEADER,
        v2.HEADER + bytes((3, SIZE + 4, 0, v2.STATUS)),
    ),
}
both = pytest.mark.parametrize("dialect", DIALECTS.values(), ids=DIALECTS)


def ids(replies: list[Any]) -> list[int]:
    return [reply.servo_id for reply in replies]


@both
def test_each_reply_has_the_number_of_garbage_bytes_before_it(dialect: Dialect) -> None:
    """The result does not depend on how the stream of bytes is split. The decoder counts bytes after the last reply."""
    chance = random.Random(5)
    for _ in range(200):
        noise = [bytes(chance.choices(range(200), k=chance.randrange(12))) for _ in range(4)]
        stream = b"".join(n + dialect.reply(i, b"abcdef", 0) for i, n in enumerate(noise[:3])) + noise[3]
        decoder, replies = dialect.decoder(SIZE), []
        while stream:
            cut = chance.randint(1, 9)
            replies += decoder.feed(stream[:cut])
            stream = stream[cut:]
        assert [(r.servo_id, r.data, r.garbage) for r in replies] == [
            (i, b"abcdef", len(n)) for i, n in enumerate(noise[:3])
        ]
        assert decoder.garbage + decoder.waiting == len(noise[3])


def test_two_partial_replies_with_a_correct_checksum_are_not_a_reply() -> None:
    """Servo 1 was at 2048. If these bytes are taken for one packet, the position in it is -32512. This occurred in
    simulated time."""
    half, whole = bytes.fromhex("ffff010a0000"), bytes.fromhex("ffff020a00e20800000001771b76")
    decoder = v1.ReplyDecoder(8)
    replies = decoder.feed(half + whole) + decoder.finish()
    assert [(reply.servo_id, reply.data.hex()) for reply in replies] == [(2, "e20800000001771b")]
    assert decoder.corrupt_ids == [1] and replies[0].garbage == len(half)


@both
def test_replies_after_a_truncated_reply_are_found_at_the_end(dialect: Dialect) -> None:
    decoder = dialect.decoder(SIZE)
    torn = dialect.reply(9, b"uvwxyz", 0)[:-1]
    assert ids(decoder.feed(torn)) == []
    assert decoder.waiting == len(torn)
    found = decoder.feed(dialect.reply(1, b"abcdef", 0) + dialect.reply(2, b"ghijkl", 0)) + decoder.finish()
    assert ids(found) == [1, 2]
    assert found[0].garbage == len(torn)
    decoder.feed(dialect.false_header)
    assert decoder.waiting == len(dialect.false_header)
    assert decoder.finish() == []
    assert (decoder.garbage, decoder.waiting) == (len(dialect.false_header), 0)


@both
def test_an_incomplete_reply_after_a_bare_header_is_found(dialect: Dialect) -> None:
    decoder = dialect.decoder(SIZE)
    assert ids(decoder.feed(dialect.false_header)) == []
    assert ids(decoder.feed(dialect.reply(4, b"abcdef", 0)) + decoder.finish()) == [4]


@both
@pytest.mark.parametrize("data_size", [0, 1, 5, 6, 7, 12])
def test_only_requested_sizes_are_replies(dialect: Dialect, data_size: int) -> None:
    decoder = dialect.decoder(SIZE, other_sizes=frozenset((12,)))
    stream = dialect.reply(1, b"abcdefghijkl"[:data_size], 0) + dialect.reply(2, b"abcdef", 0)
    assert ids(decoder.feed(stream) + decoder.finish()) == ([1, 2] if data_size in (6, 12) else [2])


@both
@pytest.mark.parametrize(("refusals", "error", "found"), [(8, 8, True), (1, 1, True), (8, 1, False), (0, 8, False)])
def test_a_reply_without_data_is_accepted_only_as_a_refusal(
    dialect: Dialect, refusals: int, error: int, found: bool
) -> None:
    decoder = dialect.decoder(SIZE, refusals=refusals)
    replies = decoder.feed(dialect.reply(5, b"", error) + dialect.reply(2, b"abcdef", 0)) + decoder.finish()
    assert ids(replies) == ([5, 2] if found else [2])
    assert [decoder.refuses(reply) for reply in replies] == ([True, False] if found else [False])


@both
def test_a_frame_of_a_wrong_size_is_skipped_at_once(dialect: Dialect) -> None:
    """The head of the packet is sufficient, and the bytes after it are decoded immediately."""
    long = dialect.reply(1, bytes(100), 0)
    decoder = dialect.decoder(SIZE)
    assert ids(decoder.feed(long[:12] + dialect.reply(2, b"abcdef", 0))) == [2]


@both
def test_replies_up_to_the_largest_id_are_accepted(dialect: Dialect) -> None:
    largest = 0xFD if dialect.decoder is v1.ReplyDecoder else v2.LARGEST_ID
    decoder = dialect.decoder(SIZE)
    assert ids(decoder.feed(dialect.reply(largest, b"abcdef", 0))) == [largest]
    beyond = dialect.reply(largest + 1, b"abcdef", 0)
    assert decoder.feed(beyond) == []
    assert decoder.waiting < len(dialect.header)


@both
def test_replies_after_several_truncated_heads_are_found_at_the_end(dialect: Dialect) -> None:
    decoder = dialect.decoder(SIZE, other_sizes=frozenset((60,)))
    torn = dialect.reply(9, bytes(60), 0)[:12]
    stream = b"abc" + torn + dialect.reply(1, b"abcdef", 0) + torn + dialect.reply(2, b"abcdef", 0)
    assert decoder.feed(stream) == []
    assert [(reply.servo_id, reply.garbage) for reply in decoder.finish()] == [(1, 3 + len(torn)), (2, len(torn))]


@both
def test_all_bytes_of_a_corrupt_reply_are_garbage(dialect: Dialect) -> None:
    broken = bytearray(dialect.reply(3, b"abcdef", 0))
    broken[-1] ^= 1
    decoder = dialect.decoder(SIZE)
    (reply,) = decoder.feed(b"abc" + bytes(broken) + dialect.reply(4, b"abcdef", 0))
    assert (reply.servo_id, reply.garbage, decoder.corrupt_ids) == (4, 3 + len(broken), [3])


@both
def test_a_checksum_that_looks_like_a_header_is_not_a_header(dialect: Dialect) -> None:
    replies = (dialect.reply(1, number.to_bytes(SIZE, "big"), 0) for number in range(1 << 16))
    stream = next(reply for reply in replies if reply[-1] == 0xFF)
    decoder = dialect.decoder(SIZE)
    assert ids(decoder.feed(stream)) == [1]
    assert (decoder.waiting, decoder.garbage) == (0, 0)


def test_errors_have_names_or_numbers() -> None:
    assert v2.error_text(4) == "received a value out of range"
    assert v2.error_text(99) == "reported error 99"


@pytest.mark.parametrize(("size", "longest"), [(12, 16), (13, 17), (14, 19)])
def test_protocol_2_waits_for_the_maximum_byte_stuffing(size: int, longest: int) -> None:
    """An FD is stuffed after each FF FF FD, so the data and the error byte may grow by a third."""
    for data, waits in ((longest, True), (longest + 1, False)):
        decoder = v2.ReplyDecoder(size)
        head = v2.HEADER + bytes((3, data + 4, 0, v2.STATUS)) + bytes(2)
        assert decoder.feed(head) == []
        assert decoder.waiting == (len(head) if waits else 0)


def test_protocol_2_removes_byte_stuffing() -> None:
    data = b"\xff\xff\xfd" * 4
    packet = status_packet(3, 0, data)
    assert len(packet) == v2.OVERHEAD + 16
    assert [reply.data for reply in v2.ReplyDecoder(len(data)).feed(packet)] == [data]
