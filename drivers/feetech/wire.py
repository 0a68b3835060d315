"""Feetech protocol 0, the master's side: pure functions from values to bytes and back.

A packet is ``FF FF id length instruction parameters checksum``; a reply has the status byte in
the instruction's place. length counts from itself to the end; the checksum is the inverted sum
from id on. Source: Feetech's "communication protocol" manual; the SDK's protocol_packet_handler.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

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
    status: int
    data: bytes


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
class ReplyDecoder:
    """Finds replies with ``data_size`` bytes of data in a stream of any pieces and any garbage.

    The size is known from the request; a frame of another size is passed over, so that noise that
    looks like a long frame cannot swallow the replies behind it.
    ``corrupt_ids`` lists what stood in the id field of frames whose checksum was wrong.
    """

    data_size: int
    corrupt_ids: list[int] = field(default_factory=list)
    _pending: bytes = b""

    def feed(self, data: bytes) -> list[Reply]:
        """The replies that end in ``data``."""
        pending = self._pending + data
        replies: list[Reply] = []
        while (start := pending.find(HEADER)) >= 0:
            pending = pending[start:]
            if len(pending) < self.data_size + OVERHEAD and self._may_begin(pending):
                self._pending = pending
                return replies
            pending = pending[self._take(pending, replies) :]
        self._pending = b"\xff" if pending.endswith(b"\xff") else b""
        return replies

    def _may_begin(self, pending: bytes) -> bool:
        """Whether a reply of the right size may begin here, as far as has been received."""
        if len(pending) > 2 and pending[2] > _LARGEST_ID:
            return False
        return len(pending) < 4 or pending[3] == self.data_size + 2

    def _take(self, pending: bytes, replies: list[Reply]) -> int:
        """Judge the frame at the start; returns how many bytes are done with."""
        frame = pending[: self.data_size + OVERHEAD]
        if not self._may_begin(frame):
            return 1
        if ~sum(frame[2:-1]) & 0xFF != frame[-1]:
            self.corrupt_ids.append(frame[2])
            return 1  # a true frame may begin inside the false one
        replies.append(Reply(frame[2], frame[4], frame[5:-1]))
        return len(frame)
