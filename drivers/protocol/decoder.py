"""Decoders find replies in a stream of any pieces and any garbage, whatever the packets."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar


@dataclass(frozen=True, slots=True)
class Reply:
    """A status packet whose checksum is right."""

    servo_id: int
    error: int
    """The byte in which the servo complains: of itself, or of what it was asked."""
    data: bytes
    garbage: int = field(default=0, compare=False)
    """Bytes before it that belong to no reply."""


@dataclass(slots=True)
class Decoder(ABC):
    """A decoder finds replies with ``data_size`` bytes of data.

    The size is known from the request; a frame of another size is passed over, so that noise that looks like a long
    frame cannot swallow the replies behind it. Only sizes in ``other_sizes`` (those of earlier requests) are found too,
    and those without data that refuse the request, by the bits ``refusals`` of the error byte. ``corrupt_ids`` lists
    the id fields of frames whose checksum was wrong; ``garbage`` counts the bytes since the last reply.
    """

    HEADER: ClassVar[bytes]

    data_size: int
    other_sizes: frozenset[int] = frozenset()
    refusals: int = 0
    corrupt_ids: list[int] = field(default_factory=list)
    garbage: int = 0
    _pending: bytes = b""

    @property
    def waiting(self) -> int:
        """Bytes of a reply whose end has not come."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Reply]:
        """Return the replies that end in ``data``."""
        header = self.HEADER
        pending = self._pending + data
        replies: list[Reply] = []
        at = 0
        while (start := pending.find(header, at)) >= 0:
            self.garbage += start - at
            taken = self._take(pending, start, replies)
            if taken is None:
                self._pending = pending[start:]
                return replies
            at = start + taken
        size = len(header) - 1
        while not pending.endswith(header[:size], at):
            size -= 1
        self.garbage += len(pending) - size - at
        self._pending = header[:size]
        return replies

    def finish(self) -> list[Reply]:
        """Return the replies behind a false header that waited for its end: nothing more comes."""
        replies: list[Reply] = []
        while self._pending:
            rest, self._pending = self._pending[1:], b""
            self.garbage += 1
            replies += self.feed(rest)
        return replies

    def refuses(self, reply: Reply) -> bool:
        """Whether the reply says that there is no answer."""
        return bool(reply.error & self.refusals)

    def _may_have(self, data_size: int) -> bool:
        """Whether a reply with so many bytes of data may be one to find."""
        return data_size == self.data_size or data_size in self.other_sizes or (data_size == 0 and self.refusals > 0)

    def _found(self, reply: Reply, frame_size: int, replies: list[Reply]) -> int:
        """Take a packet that holds together and may be one to find; returns how many bytes it took."""
        if not (reply.data or self.refuses(reply)):  # an acknowledgement, of no question of ours
            return self._pass()
        replies.append(reply)
        self.garbage = 0
        return frame_size

    @abstractmethod
    def _take(self, pending: bytes, at: int, replies: list[Reply]) -> int | None:
        """Judge what begins with the header at ``at``; how many bytes are done with, None if more are needed."""

    def _pass(self, size: int = 1) -> int:
        """Count bytes that belong to no reply. After one, because a true frame may begin inside a false one."""
        self.garbage += size
        return size
