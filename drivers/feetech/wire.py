"""Feetech protocol 0, the master's side: pure functions from values to bytes and back.

A packet is ``FF FF id length instruction parameters checksum``; a reply has the status byte in
the instruction's place. length counts from itself to the end; the checksum is the inverted sum
from id on. Source: Feetech's "communication protocol" manual; the SDK's protocol_packet_handler.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from drivers.decoder import Decoder

BROADCAST_ID = 0xFE
HEADER = b"\xff\xff"
OVERHEAD = 6
"""Bytes of a reply beside its data: header, id, length, status, checksum."""

SYNC_READ = 0x82
SYNC_WRITE = 0x83

_LARGEST_ID = 0xFD


@dataclass(frozen=True, slots=True)
class Reply:
    """A status packet whose checksum is right."""

    servo_id: int
    error: int
    """The status byte."""
    data: bytes
    garbage: int = field(default=0, compare=False)
    """Bytes before it that belong to no reply."""


def packet(servo_id: int, instruction: int, parameters: bytes) -> bytes:
    """An instruction packet with its checksum."""
    body = bytes((servo_id, len(parameters) + 2, instruction)) + parameters
    return HEADER + body + bytes((~sum(body) & 0xFF,))


def sync_read(servo_ids: Sequence[int], address: int, size: int) -> bytes:
    """Asks each servo in turn for ``size`` bytes at ``address``."""
    return packet(BROADCAST_ID, SYNC_READ, bytes((address, size, *servo_ids)))


def sync_write(address: int, size: int, data: Mapping[int, bytes]) -> bytes:
    """Writes ``size`` bytes at ``address`` of each servo; there is no reply."""
    body = b"".join(bytes((servo_id,)) + content for servo_id, content in data.items())
    return packet(BROADCAST_ID, SYNC_WRITE, bytes((address, size)) + body)


@dataclass(slots=True)
class ReplyDecoder(Decoder[Reply]):
    """Finds replies."""

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
        if ~sum(frame[2:-1]) & 0xFF != frame[-1]:
            self.corrupt_ids.append(frame[2])
            return self._pass()
        return self._found(Reply(frame[2], frame[4], frame[5:-1], self.garbage), len(frame), replies)
