"""Packets of Feetech's protocols and of Dynamixel protocol 1.0, the master's side: from values to bytes and back.

A packet is ``FF FF id length instruction parameters checksum``; a reply has the status byte in
the instruction's place. length counts from itself to the end; the checksum is the inverted sum
from id on. Source: Feetech's "communication protocol" manual; the SDK's protocol_packet_handler;
ROBOTIS e-manual, "Protocol 1.0".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Any
from zlib import adler32

from drivers.protocol.decoder import Decoder, Reply

BROADCAST_ID = 0xFE
HEADER = b"\xff\xff"
OVERHEAD = 6  # bytes of a reply beside its data: header, id, length, status, checksum

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
_LARGEST_BODY = 0xFF - 4  # of a sync write, whose length is a byte
_HEAD = Struct(">HBBB").pack
_CHECKSUMS = tuple(bytes((~(adler - 1 - sum(HEADER)) & 0xFF,)) for adler in range(256))
"""By the lower byte of Adler-32, whose lower half is 1 more than the sum of up to 256 bytes (RFC 1950), of all before:
that takes a quarter of the time of ``sum``."""


def packet(servo_id: int, instruction: int, parameters: bytes) -> bytes:
    """An instruction packet with its checksum."""
    body = _HEAD(0xFFFF, servo_id, len(parameters) + 2, instruction) + parameters
    return body + _CHECKSUMS[adler32(body) & 0xFF]


def span(address: int, size: int) -> bytes:
    """``size`` bytes from ``address``, as all instructions say it."""
    return bytes((address, size))


def place(address: int) -> bytes:
    """Where a write begins."""
    return bytes((address,))


def bulk_read(spans: Mapping[int, tuple[int, int]]) -> bytes:
    """Asks each servo in turn for its own bytes: address and size, by ID. Dynamixel protocol 1.0, MX only."""
    return packet(BROADCAST_ID, BULK_READ, b"\0" + b"".join(bytes((size, i, at)) for i, (at, size) in spans.items()))


def sync_read(servo_ids: Sequence[int], address: int, size: int) -> bytes:
    """Asks each servo in turn for ``size`` bytes at ``address``."""
    return packet(BROADCAST_ID, SYNC_READ, bytes((address, size, *servo_ids)))


def sync_write(address: int, size: int, entries: bytes) -> bytes:
    """Writes ``size`` bytes at ``address`` of each servo; there is no reply. An entry is an ID and the bytes."""
    if len(entries) > _LARGEST_BODY:
        most, count = _LARGEST_BODY // (size + 1), len(entries) // (size + 1)
        raise ValueError(f"a packet holds {most} goals, not {count}: use another port")
    return packet(BROADCAST_ID, SYNC_WRITE, bytes((address, size)) + entries)


def sdk_request(servo_id: int, instruction: int, parameters: bytes) -> list[int]:
    """A packet as the SDKs' ``txRxPacket`` takes it, which fills in header and checksum."""
    return [0, 0, servo_id, len(parameters) + 2, instruction, *parameters, 0]


def sdk_data(reply: Any) -> bytes:
    """The data of a reply as the SDKs hand it over."""
    return bytes(reply[5 : reply[3] + 3])


@dataclass(slots=True)
class ReplyDecoder(Decoder):
    """The decoder of these packets. A header inside one is that of the next, behind a half packet: no data hold it."""

    HEADER = HEADER

    def _take(self, pending: bytes, at: int, replies: list[Reply]) -> int | None:
        left = len(pending) - at
        if left > 2 and pending[at + 2] > _LARGEST_ID:
            return self._pass()
        size = pending[at + 3] - 2 if left > 3 else self.data_size
        if not self._may_have(size):
            return self._pass()
        if left < size + OVERHEAD:
            return None
        frame = pending[at : at + size + OVERHEAD]
        if _CHECKSUMS[adler32(frame[:-1]) & 0xFF] != frame[-1:] or HEADER in frame[2:]:
            self.corrupt_ids.append(frame[2])
            return self._pass()
        return self._found(Reply(frame[2], frame[4], frame[5:-1], self.garbage), len(frame), replies)
