"""Encode and decode the packets of Dynamixel protocol 2.0, on the master's side.

A packet is ``FF FF FD 00 id length instruction parameters crc``. All numbers are little endian. The length (two
bytes) counts all bytes from the instruction to the end. In a reply, the instruction is 0x55, followed by an error byte.
An extra FD is inserted after each FF FF FD from the instruction onward, so that the header occurs only at the start.
The checksum is CRC-16/UMTS (polynomial 0x8005, initial value 0, not reflected). Source: ROBOTIS e-manual, "Protocol
2.0", "CRC calculation".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fastcrc.crc16 import umts as crc16

from drivers.protocol.decoder import Decoder, Reply

BROADCAST_ID = 0xFE
LARGEST_ID = 252
HEADER = b"\xff\xff\xfd\x00"
OVERHEAD = 11
"""Bytes of a reply in addition to its data: header, ID, length, instruction, error, CRC."""

PING = 0x01
READ = 0x02
WRITE = 0x03
REG_WRITE = 0x04
FACTORY_RESET = 0x06
KEEP_ID_AND_BAUD = 0x02
"""Factory reset option that keeps the ID and the baud rate."""
REBOOT = 0x08
STATUS = 0x55
SYNC_READ = 0x82
SYNC_WRITE = 0x83
FAST_SYNC_READ = 0x8A
BULK_READ = 0x92

FAST_HEAD_SIZE = 8
"""Bytes before the first servo's section of a fast sync read reply: header, ID, length, instruction."""
FAST_OVERHEAD = 4
"""Bytes in a servo's section in addition to its data: error, ID, CRC."""

ALERT = 0x80
"""Bit of the error byte that reports a hardware error. The servo has still executed the instruction."""
CORRUPT_PACKET, NO_ACCESS = 3, 7
_ERRORS = {
    1: "could not execute the instruction (if it has a hardware error, reboot it)",
    2: "does not know the instruction",
    CORRUPT_PACKET: "received a corrupt packet",
    4: "received a value out of range",
    5: "received too few bytes",
    6: "received a value beyond its limit",
    NO_ACCESS: "does not have this register, or the register is locked while torque is enabled",
}
"""Meaning of the error number in the other bits of the error byte."""

PATTERN = b"\xff\xff\xfd"
_STUFFED = b"\xff\xff\xfd\xfd"
_HEAD = 7
"""Number of bytes before the instruction."""


def error_text(number: int) -> str:
    """Return the meaning of an error number, worded to follow the servo's name."""
    return _ERRORS.get(number, f"reported error {number}")


def packet(servo_id: int, instruction: int, parameters: bytes) -> bytes:
    """Encode an instruction packet with byte stuffing."""
    body = stuffed(bytes((instruction,)) + parameters)
    head = HEADER + bytes((servo_id,)) + (len(body) + 2).to_bytes(2, "little")
    return head + body + crc16(head + body).to_bytes(2, "little")


def stuffed(body: bytes) -> bytes:
    """Add byte stuffing to the part of a packet between its length and its checksum."""
    return body.replace(PATTERN, _STUFFED)


def unstuffed(body: bytes) -> bytes:
    return body.replace(_STUFFED, PATTERN)


def span(address: int, size: int) -> bytes:
    """Encode the parameters that select ``size`` bytes at ``address``."""
    return address.to_bytes(2, "little") + size.to_bytes(2, "little")


def place(address: int) -> bytes:
    return address.to_bytes(2, "little")


def sync_read(servo_ids: Sequence[int], address: int, size: int) -> bytes:
    return packet(BROADCAST_ID, SYNC_READ, span(address, size) + bytes(servo_ids))


def fast_sync_read(servo_ids: Sequence[int], address: int, size: int) -> bytes:
    """Encode a fast sync read, to which all servos reply with one common packet."""
    return packet(BROADCAST_ID, FAST_SYNC_READ, span(address, size) + bytes(servo_ids))


def fast_head(count: int, size: int) -> bytes:
    """Encode the start of a reply from ``count`` servos, which precedes the error, ID, data and CRC of each servo."""
    length = 1 + count * (size + FAST_OVERHEAD)
    return HEADER + bytes((BROADCAST_ID,)) + length.to_bytes(2, "little") + bytes((STATUS,))


def bulk_read(spans: Mapping[int, tuple[int, int]]) -> bytes:
    """Encode a bulk read of the address and size in ``spans``, keyed by servo ID."""
    return packet(BROADCAST_ID, BULK_READ, b"".join(bytes((i,)) + span(*place) for i, place in spans.items()))


def sync_write(address: int, size: int, entries: bytes) -> bytes:
    """Encode a sync write of ``size`` bytes at ``address``. Each entry is an ID and the bytes. Servos do not reply."""
    return packet(BROADCAST_ID, SYNC_WRITE, span(address, size) + entries)


def sdk_request(servo_id: int, instruction: int, parameters: bytes) -> list[int]:
    """Return a packet with byte stuffing for ``txRxPacket`` of the SDK, which computes the stuffed bytes but omits
    them."""
    body = stuffed(parameters)
    return [0, 0, 0, 0, servo_id, *(len(body) + 3).to_bytes(2, "little"), instruction, *body, 0, 0]


def sdk_data(reply: Any) -> bytes:
    return bytes(reply[9 : reply[5] + (reply[6] << 8) + 5])


@dataclass(slots=True)
class ReplyDecoder(Decoder):
    """Decoder for replies with or without byte stuffing. Sizes do not include stuffed bytes."""

    HEADER = HEADER

    refusals: int = 0xFF & ~ALERT

    def _decode(self, pending: bytes, at: int, replies: list[Reply]) -> int | None:
        left = len(pending) - at
        if left > 4 and pending[at + 4] > LARGEST_ID:
            return self._skip()
        if left <= _HEAD:
            return None
        length = int.from_bytes(pending[at + 5 : at + 7], "little") + _HEAD
        if pending[at + _HEAD] != STATUS or not self._plausible(length):
            return self._skip()
        if left < length:
            return None
        return self._check(pending[at : at + length], replies)

    def _plausible(self, size: int) -> bool:
        """Return whether a reply with an accepted data size may be ``size`` bytes long, including stuffed bytes."""
        data = size - OVERHEAD
        return any(wanted <= data <= wanted + (wanted + 1) // 3 for wanted in (self.data_size, *self.other_sizes, 0))

    def _check(self, frame: bytes, replies: list[Reply]) -> int:
        if crc16(frame[:-2]) != int.from_bytes(frame[-2:], "little"):
            self.corrupt_ids.append(frame[4])
            return self._skip()
        body = unstuffed(frame[_HEAD:-2])
        if not self._accepts(len(body) - 2):
            return self._skip(len(frame))
        return self._accept(Reply(frame[4], body[1], body[2:], self.garbage), len(frame), replies)
