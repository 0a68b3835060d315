"""Ten million random bytes in random pieces through the decoder: ``python -m bench.decoder [--bytes 10000000]``.

Half of them are rich in what headers are made of. It neither raises nor accepts a frame whose checksum is
wrong, keeps little, and finds the next good frame. Ends with 1 where that is not so.
"""

import argparse
import random
import time

from bench.arguments import positive
from drivers.feetech import wire

DATA_SIZE = 8
LONGEST_PIECE = 400
TRICKY = bytes((0xFF, 0xFF, 0xFF, DATA_SIZE + 2, 1, 0, 0xFE, 7))
GOOD = wire.packet(5, 0, bytes(range(DATA_SIZE)))
SILENCE = bytes(DATA_SIZE + wire.OVERHEAD)


def pieces(size: int, seed: int) -> list[bytes]:
    """About ``size`` random bytes in pieces of random length; every second one is tricky."""
    chance = random.Random(seed)
    table = bytes(TRICKY[i % len(TRICKY)] for i in range(256))
    made: list[bytes] = []
    total = 0
    while total < size:
        piece = chance.randbytes(chance.randint(1, LONGEST_PIECE))
        made.append(piece.translate(table) if len(made) % 2 else piece)
        total += len(piece)
    return made


def frame_of(reply: wire.Reply) -> bytes:
    """The only bytes from which this reply may have been read, spelled out as the manual does."""
    body = bytes((reply.servo_id, len(reply.data) + 2, reply.error)) + reply.data
    return b"\xff\xff" + body + bytes((255 - sum(body) % 256,))


def flood(noise: list[bytes]) -> tuple[int, int]:
    """How many frames were believed, and how many of them do not stand in the stream with their checksum."""
    decoder = wire.ReplyDecoder(DATA_SIZE)
    believed = wrong = 0
    before = b""
    for piece in noise:
        seen = before + piece
        for reply in decoder.feed(piece):
            believed += 1
            wrong += frame_of(reply) not in seen
        assert decoder.waiting < DATA_SIZE + wire.OVERHEAD, "bytes are hoarded"
        decoder.corrupt_ids.clear()
        before = seen[-(DATA_SIZE + wire.OVERHEAD) :]
    found = decoder.feed(SILENCE + GOOD)
    assert found and found[-1].data == bytes(range(DATA_SIZE)), "the next good frame was not found"
    return believed, wrong


def main() -> None:
    """Print the count and the rate."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--bytes", type=positive, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    noise = pieces(arguments.bytes, arguments.seed)
    begin_s = time.perf_counter()
    believed, wrong = flood(noise)
    took_s = time.perf_counter() - begin_s
    print(f"{arguments.bytes} bytes in {len(noise)} pieces, {took_s:.1f} s: {believed} frames, {wrong} of them wrong")
    raise SystemExit(1 if wrong else 0)


if __name__ == "__main__":
    main()
