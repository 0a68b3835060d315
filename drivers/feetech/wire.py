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
class ReplyDecoder:
    """Finds replies with ``data_size`` bytes of data in a stream of any pieces and any garbage.

    The size is known from the request; a frame of another size is passed over, so that noise that
    looks like a long frame cannot swallow the replies behind it. Only sizes in ``other_sizes`` (those
    of earlier requests) are found too.
    ``corrupt_ids`` lists what stood in the id field of frames whose checksum was wrong; ``garbage``
    counts the bytes since the last reply that belong to none.
    """

    data_size: int
    other_sizes: frozenset[int] = frozenset()
    corrupt_ids: list[int] = field(default_factory=list)
    garbage: int = 0
    _pending: bytes = b""

    @property
    def waiting(self) -> int:
        """Bytes of a reply whose end has not come."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Reply]:
        """The replies that end in ``data``."""
        pending = self._pending + data
        replies: list[Reply] = []
        at = 0
        while (start := pending.find(HEADER, at)) >= 0:
            self.garbage += start - at
            at = start
            end = self._end(pending, at)
            if end > len(pending):
                self._pending = pending[at:]
                return replies
            at += self._take(pending[at:end], replies)
        at_end = len(pending) - pending.endswith(b"\xff", at)
        self.garbage += at_end - at
        self._pending = pending[at_end:]
        return replies

    def finish(self) -> list[Reply]:
        """Nothing more comes: the replies behind a false header that waited for its end."""
        replies: list[Reply] = []
        while self._pending:
            rest, self._pending = self._pending[1:], b""
            self.garbage += 1
            replies += self.feed(rest)
        return replies

    def _end(self, pending: bytes, at: int) -> int:
        """Where a frame that begins at ``at`` would end; where it begins, if it can be none."""
        left = len(pending) - at
        if left > 2 and pending[at + 2] > _LARGEST_ID:
            return at
        size = pending[at + 3] - 2 if left > 3 else self.data_size
        if size != self.data_size and size not in self.other_sizes:
            return at
        return at + size + OVERHEAD

    def _take(self, frame: bytes, replies: list[Reply]) -> int:
        """Judge what may be a frame; returns how many bytes are done with."""
        if frame and ~sum(frame[2:-1]) & 0xFF == frame[-1]:
            replies.append(Reply(frame[2], frame[4], frame[5:-1], self.garbage))
            self.garbage = 0
            return len(frame)
        if frame:
            self.corrupt_ids.append(frame[2])
        self.garbage += 1
        return 1  # a true frame may begin inside the false one
