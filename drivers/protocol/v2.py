"""Dynamixel protocol 2.0, the master's side: pure functions from values to bytes and back.

A packet is ``FF FF FD 00 id length instruction parameters crc``; length (two bytes, low byte first,
as all numbers) counts from the instruction to the end. A reply's instruction is 0x55, and an error
byte follows it. Where FF FF FD occurs from the instruction on, an FD is stuffed behind it, so the
header occurs nowhere but at the beginning. The checksum is CRC-16 with polynomial 0x8005 from zero, nothing
reflected (CRC-16/UMTS). Source: ROBOTIS e-manual, "Protocol 2.0", "CRC calculation".
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
"""Bytes of a reply beside its data: header, id, length, instruction, error, CRC."""

PING = 0x01
READ = 0x02
WRITE = 0x03
REG_WRITE = 0x04
FACTORY_RESET = 0x06
KEEP_ID_AND_BAUD = 0x02
"""Option of a factory reset."""
REBOOT = 0x08
STATUS = 0x55
SYNC_READ = 0x82
SYNC_WRITE = 0x83
FAST_SYNC_READ = 0x8A
BULK_READ = 0x92

FAST_HEAD_SIZE = 8
"""Bytes of a fast sync read's reply before the first servo's piece: header, id, length, instruction."""
FAST_OVERHEAD = 4
"""Bytes of a servo's piece beside its data: error, id, CRC."""

ALERT = 0x80
"""Bit of the error byte: the servo has a hardware error. It did what it was told all the same."""
CAME_BROKEN, NO_ACCESS = 3, 7
_ERRORS = {
    1: "could not do it (after a hardware error: reboot it)",
    2: "does not know the instruction",
    CAME_BROKEN: "received a broken packet",
    4: "was given a value out of range",
    5: "was given too few bytes",
    6: "was given a value beyond its limit",
    NO_ACCESS: "has no such register, or it is locked while the torque is on",
}
"""Meaning of the error byte's other bits, which are one number."""

PATTERN = b"\xff\xff\xfd"
_STUFFED = b"\xff\xff\xfd\xfd"
_HEAD = 7
"""Bytes before the instruction."""


def error_text(number: int) -> str:
    """Behind "it" or the servo's name."""
    return _ERRORS.get(number, f"answered error {number}")


def packet(servo_id: int, instruction: int, parameters: bytes) -> bytes:
    """An instruction packet, stuffed, with its checksum."""
    body = stuffed(bytes((instruction,)) + parameters)
    head = HEADER + bytes((servo_id,)) + (len(body) + 2).to_bytes(2, "little")
    return head + body + crc16(head + body).to_bytes(2, "little")


def stuffed(body: bytes) -> bytes:
    """What stands between a packet's length and its checksum, with the stuffing."""
    return body.replace(PATTERN, _STUFFED)


def unstuffed(body: bytes) -> bytes:
    """What was stuffed, without the stuffing."""
    return body.replace(_STUFFED, PATTERN)


def span(address: int, size: int) -> bytes:
    """``size`` bytes from ``address``, as all instructions say it."""
    return address.to_bytes(2, "little") + size.to_bytes(2, "little")


def place(address: int) -> bytes:
    """Where a write begins."""
    return address.to_bytes(2, "little")


def sync_read(servo_ids: Sequence[int], address: int, size: int) -> bytes:
    """Asks each servo in turn for ``size`` bytes at ``address``."""
    return packet(BROADCAST_ID, SYNC_READ, span(address, size) + bytes(servo_ids))


def fast_sync_read(servo_ids: Sequence[int], address: int, size: int) -> bytes:
    """As ``sync_read``, but they answer with one packet in which each has its piece."""
    return packet(BROADCAST_ID, FAST_SYNC_READ, span(address, size) + bytes(servo_ids))


def fast_head(count: int, size: int) -> bytes:
    """How the reply of ``count`` servos to a fast sync read begins; error, id, data and CRC of each follow."""
    length = 1 + count * (size + FAST_OVERHEAD)
    return HEADER + bytes((BROADCAST_ID,)) + length.to_bytes(2, "little") + bytes((STATUS,))


def bulk_read(spans: Mapping[int, tuple[int, int]]) -> bytes:
    """Asks each servo in turn for its own bytes: address and size, by ID."""
    return packet(BROADCAST_ID, BULK_READ, b"".join(bytes((i,)) + span(*place) for i, place in spans.items()))


def sync_write(address: int, size: int, entries: bytes) -> bytes:
    """Writes ``size`` bytes at ``address`` of each servo; there is no reply. An entry is an ID and the bytes."""
    return packet(BROADCAST_ID, SYNC_WRITE, span(address, size) + entries)


def sdk_request(servo_id: int, instruction: int, parameters: bytes) -> list[int]:
    """A packet as the SDK's ``txRxPacket`` takes it, which fills in header and checksum.

    Stuffed here: the SDK computes the stuffing and then sends the packet without it.
    """
    body = stuffed(parameters)
    return [0, 0, 0, 0, servo_id, *(len(body) + 3).to_bytes(2, "little"), instruction, *body, 0, 0]


def sdk_data(reply: Any) -> bytes:
    """The data of a reply as the SDK hands it over."""
    return bytes(reply[9 : reply[5] + (reply[6] << 8) + 5])


@dataclass(slots=True)
class ReplyDecoder(Decoder):
    """The decoder of replies, stuffed or not. Sizes are those without the stuffing."""

    HEADER = HEADER

    refusals: int = 0xFF & ~ALERT

    def _take(self, pending: bytes, at: int, replies: list[Reply]) -> int | None:
        left = len(pending) - at
        if left > 4 and pending[at + 4] > LARGEST_ID:
            return self._pass()
        if left <= _HEAD:
            return None
        length = int.from_bytes(pending[at + 5 : at + 7], "little") + _HEAD
        if pending[at + _HEAD] != STATUS or not self._plausible(length):
            return self._pass()
        if left < length:
            return None
        return self._judge(pending[at : at + length], replies)

    def _plausible(self, size: int) -> bool:
        """Whether a reply of a right size, stuffed or not, may be so long."""
        data = size - OVERHEAD
        return any(wanted <= data <= wanted + (wanted + 1) // 3 for wanted in (self.data_size, *self.other_sizes, 0))

    def _judge(self, frame: bytes, replies: list[Reply]) -> int:
        if crc16(frame[:-2]) != int.from_bytes(frame[-2:], "little"):
            self.corrupt_ids.append(frame[4])
            return self._pass()
        body = unstuffed(frame[_HEAD:-2])
        if not self._may_have(len(body) - 2):
            return self._pass(len(frame))
        return self._found(Reply(frame[4], body[1], body[2:], self.garbage), len(frame), replies)
