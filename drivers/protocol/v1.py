"""Encode and decode the packets of the Feetech protocols and Dynamixel protocol 1.0, on the master's side.

A packet is ``FF FF id length instruction parameters checksum``. A reply has a status byte instead of the
instruction. The length counts all bytes that follow it. The checksum is the inverted sum of all bytes from the ID
onward. Sources: Feetech's "communication protocol" manual; protocol_packet_handler in Feetech's SDK; ROBOTIS e-manual,
"Protocol 1.0".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Any
from zlib import adler32

from drivers.protocol.decoder import Decoder, Reply

BROADCAST_ID = 0xFE
HEADER = b"\xff\xff"
OVERHEAD = 6  # bytes of a reply in addition to its data: header, ID, length, status, checksum

PING = 0x01
READ = 0x02
WRITE = 0x03
REG_WRITE = 0x04
FACTORY_RESET = 0x06
REBOOT = 0x08
FORGET_TURNS = 0x0A
SYNC_READ = 0x82
SYNC_WRITE = 0x83
BULK_READ = 0x92

_LARGEST_ID = 0xFD
LARGEST_BODY = 0xFF - 4  # maximum size of the entries in a sync write, whose length field is one byte
_HEAD = Struct(">HBBB").pack
_CHECKSUMS = tuple(bytes((~(adler - 1 - sum(HEADER)) & 0xFF,)) for adler in range(256))
"""Checksum for each low byte of Adler-32 over the packet. The low half of Adler-32 is 1 plus the sum of up to 256 bytes
(RFC 1950), and computing it takes a quarter of the time of ``sum``."""


def packet(servo_id: int, instruction: int, parameters: bytes) -> bytes:
    body = _HEAD(0xFFFF, servo_id, len(parameters) + 2, instruction) + parameters
    return body + _CHECKSUMS[adler32(body) & 0xFF]


def span(address: int, size: int) -> bytes:
    """Encode the parameters that select ``size`` bytes at ``address``."""
    return bytes((address, size))


def place(address: int) -> bytes:
    return bytes((address,))


def bulk_read(spans: Mapping[int, tuple[int, int]]) -> bytes:
    """Encode a bulk read of the addresses and sizes in ``spans``, keyed by servo ID.

    Only Dynamixel MX servos support bulk reads.
    """
    return packet(BROADCAST_ID, BULK_READ, b"\0" + b"".join(bytes((size, i, at)) for i, (at, size) in spans.items()))


def sync_read(servo_ids: Sequence[int], address: int, size: int) -> bytes:
    return packet(BROADCAST_ID, SYNC_READ, bytes((address, size, *servo_ids)))


def sync_write(address: int, size: int, entries: bytes) -> bytes:
    """Encode a sync write of ``size`` bytes at ``address``. Each entry consists of an ID and the bytes to write. Servos
    do not reply."""
    if len(entries) > LARGEST_BODY:
        most, count = LARGEST_BODY // (size + 1), len(entries) // (size + 1)
        raise ValueError(
            f"{count} goals do not fit into a packet, which holds at most {most}: connect some servos to another port"
        )
    return packet(BROADCAST_ID, SYNC_WRITE, bytes((address, size)) + entries)


def sdk_request(servo_id: int, instruction: int, parameters: bytes) -> list[int]:
    """Return a packet for ``txRxPacket`` of the SDKs, which fills in the header and the checksum."""
    return [0, 0, servo_id, len(parameters) + 2, instruction, *parameters, 0]


def sdk_data(reply: Any) -> bytes:
    return bytes(reply[5 : reply[3] + 3])


@dataclass(slots=True)
class ReplyDecoder(Decoder):
    """Decoder for these packets.

    The data never contain a header, so a header within a packet is the start of the next packet.
    """

    HEADER = HEADER

    def _decode(self, pending: bytes, at: int, replies: list[Reply]) -> int | None:
        left = len(pending) - at
        if left > 2 and pending[at + 2] > _LARGEST_ID:
            return self._skip()
        size = pending[at + 3] - 2 if left > 3 else self.data_size
        if not self._accepts(size):
            return self._skip()
        if left < size + OVERHEAD:
            return None
        frame = pending[at : at + size + OVERHEAD]
        if _CHECKSUMS[adler32(frame[:-1]) & 0xFF] != frame[-1:] or HEADER in frame[2:]:
            self.corrupt_ids.append(frame[2])
            return self._skip()
        return self._accept(Reply(frame[2], frame[4], frame[5:-1], self.garbage), len(frame), replies)
