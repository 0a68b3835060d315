"""Feed ten million random bytes in random chunks to each decoder: ``python -m benchmarks.decoder [--bytes 10000000]``.

One third of the bytes contains many header bytes. Another third consists of replies, headers, truncated replies and
replies with a flipped bit. A decoder must not raise an error, accept a frame with a wrong checksum or buffer many
bytes, and it must find the next valid frame. The exit status is 1 if one of these conditions is violated.
"""

import argparse
import random
import time
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.shared.arguments import positive
from drivers.protocol import v1 as feetech
from drivers.protocol import v2 as protocol2
from drivers.protocol.decoder import Decoder, Reply

DATA_SIZE = 8
CONTENT = bytes(range(DATA_SIZE))
LONGEST_PIECE = 400
LONGEST_FRAME = 22
"""Length of the longest frame, a stuffed protocol 2.0 frame, in bytes."""
SILENCE = bytes(LONGEST_FRAME)
PROBED = 100
"""Number of chunks between two probes. A probe consists of silence, a truncated frame and a valid frame, which are fed
byte by byte."""


@dataclass(frozen=True)
class StreamKind:
    """Decoder under test, with its frame encoder, its frame check and bytes that occur often in its frames."""

    decoder: Callable[[], Decoder]
    frame: Callable[[int, int, bytes], bytes]
    """Function that encodes a valid reply from ID, error and data."""
    stands: Callable[[bytes, Reply], bool]
    """Function that returns whether these bytes contain the reply with a valid checksum, independently of the code
    under test."""
    tricky: bytes
    """Eight bytes that occur often in frames."""


def stands_in_feetech(seen: bytes, reply: Reply) -> bool:
    """Return whether the bytes contain the only encoding of the reply that the manual allows."""
    body = bytes((reply.servo_id, len(reply.data) + 2, reply.error)) + reply.data
    return b"\xff\xff" + body + bytes((255 - sum(body) % 256,)) in seen


def crc_bit_by_bit(data: bytes) -> int:
    """Return the CRC-16 with polynomial 0x8005 and initial value 0, as defined in the e-manual."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x18005 if crc & 0x8000 else crc << 1
    return crc


def stands_in_protocol2(seen: bytes, reply: Reply) -> bool:
    """Return whether a packet in these bytes decodes to the reply, regardless of its byte stuffing."""
    head = b"\xff\xff\xfd\x00" + bytes((reply.servo_id,))
    says = bytes((0x55, reply.error)) + reply.data
    at = seen.find(head)
    while at >= 0:
        end = at + 7 + int.from_bytes(seen[at + 5 : at + 7], "little")
        packet = seen[at:end]
        body = packet[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        if end <= len(seen) and body == says and crc_bit_by_bit(packet[:-2]) == int.from_bytes(packet[-2:], "little"):
            return True
        at = seen.find(head, at + 1)
    return False


def protocol2_frame(servo_id: int, error: int, data: bytes) -> bytes:
    """Return a status packet."""
    return protocol2.packet(servo_id, protocol2.STATUS, bytes((error,)) + data)


KINDS = {
    "Feetech and protocol 1.0": StreamKind(
        lambda: feetech.ReplyDecoder(DATA_SIZE),
        feetech.packet,
        stands_in_feetech,
        bytes((0xFF, 0xFF, 0xFF, DATA_SIZE + 2, 1, 0, 0xFE, 7)),
    ),
    "protocol 2.0": StreamKind(
        lambda: protocol2.ReplyDecoder(DATA_SIZE),
        protocol2_frame,
        stands_in_protocol2,
        bytes((0xFF, 0xFF, 0xFD, 0xFD, 0, 0x55, DATA_SIZE + 4, 1)),
    ),
}


def scrap(kind: StreamKind, chance: random.Random, table: bytes) -> bytes:
    """Return a valid reply, a truncated reply (maybe only its header), a reply with a flipped bit, or a few bytes."""
    content = chance.randbytes(chance.choice((DATA_SIZE, DATA_SIZE, DATA_SIZE, 0))).translate(table)
    frame = kind.frame(chance.randrange(253), chance.randrange(256), content)
    match chance.randrange(4):
        case 0:
            return frame
        case 1:
            return frame[: chance.randrange(len(frame))]
        case 2:
            bit = 1 << chance.randrange(len(frame) * 8)
            return (int.from_bytes(frame, "big") ^ bit).to_bytes(len(frame), "big")
    return chance.randbytes(chance.randrange(4)).translate(table)


def pieces(kind: StreamKind, size: int, seed: int) -> list[bytes]:
    """Return about ``size`` bytes in chunks of random length.

    Random bytes, bytes that occur often in frames, and fragments of frames alternate.
    """
    chance = random.Random(seed)
    table = bytes(kind.tricky[i % len(kind.tricky)] for i in range(256))
    scraps = b"".join(scrap(kind, chance, table) for _ in range(20_000))
    made: list[bytes] = []
    total = 0
    while total < size:
        length = chance.randint(1, LONGEST_PIECE)
        at = chance.randrange(len(scraps) - length)
        turn = len(made) % 3
        piece = scraps[at : at + length] if turn == 2 else chance.randbytes(length)
        made.append(piece.translate(table) if turn == 1 else piece)
        total += length
    return made


def flood(kind: StreamKind, noise: list[bytes]) -> tuple[int, int]:
    """Return the number of accepted frames, and how many of them do not occur in the stream with a valid checksum."""
    decoder = kind.decoder()
    probe = SILENCE + kind.frame(6, 0, CONTENT)[:-3] + kind.frame(5, 0, CONTENT)
    believed = wrong = 0
    before = b""
    for number, noisy in enumerate(noise, 1):
        probing = number % PROBED == 0 or number == len(noise)
        parts = [noisy, *(probe[at : at + 1] for at in range(len(probe)))] if probing else [noisy]
        seen = before + b"".join(parts)
        replies = [reply for part in parts for reply in decoder.feed(part)]
        believed += len(replies)
        wrong += sum(not kind.stands(seen, reply) for reply in replies)
        assert decoder.waiting < LONGEST_FRAME, "the decoder keeps too many bytes"
        found = replies and (replies[-1].servo_id, replies[-1].data) == (5, CONTENT)
        assert found or not probing, "the next good frame was not found"
        decoder.corrupt_ids.clear()
        before = seen[-LONGEST_FRAME:]
    return believed, wrong


def main() -> None:
    """Print the counts and the rates."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--bytes", type=positive, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    all_wrong = 0
    for name, kind in KINDS.items():
        noise = pieces(kind, arguments.bytes, arguments.seed)
        begin_s = time.perf_counter()
        believed, wrong = flood(kind, noise)
        took_s = time.perf_counter() - begin_s
        counts = f"{believed} frames, of which {wrong} are wrong"
        print(f"{name}: decoded {arguments.bytes} bytes in {len(noise)} chunks in {took_s:.1f} s: {counts}")
        all_wrong += wrong
    raise SystemExit(1 if all_wrong else 0)


if __name__ == "__main__":
    main()
