"""Find reply packets in a byte stream that may be fragmented and contain garbage."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar


@dataclass(frozen=True, slots=True)
class Reply:
    """A status packet with a correct checksum."""

    servo_id: int
    error: int
    """Error byte of the reply, which reports servo alarms or errors in the request."""
    data: bytes
    garbage: int = field(default=0, compare=False)
    """Number of bytes between the previous reply and this reply that do not belong to either reply."""


@dataclass(slots=True)
class Decoder(ABC):
    """Decoder for replies with ``data_size`` bytes of data, as requested.

    The decoder skips frames of any other size, so that noise that looks like a long frame cannot hide the replies after
    it. The decoder also accepts the data sizes of earlier requests (``other_sizes``). It accepts a reply without data
    if the reply rejects the request (a bit of ``refusals`` is set in its error byte). ``corrupt_ids`` lists the IDs
    found in frames with a wrong checksum. ``garbage`` is the number of unused bytes since the last reply.
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
        """Number of received bytes of an incomplete reply."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Reply]:
        """Add received bytes and return the replies that are now complete."""
        header = self.HEADER
        pending = self._pending + data
        replies: list[Reply] = []
        at = 0
        while (start := pending.find(header, at)) >= 0:
            self.garbage += start - at
            consumed = self._decode(pending, start, replies)
            if consumed is None:
                self._pending = pending[start:]
                return replies
            at = start + consumed
        size = len(header) - 1
        while not pending.endswith(header[:size], at):
            size -= 1
        self.garbage += len(pending) - size - at
        self._pending = header[:size]
        return replies

    def finish(self) -> list[Reply]:
        """Return the replies that follow a false header. Call this method when no more bytes are expected."""
        replies: list[Reply] = []
        while self._pending:
            rest, self._pending = self._pending[1:], b""
            self.garbage += 1
            replies += self.feed(rest)
        return replies

    def refuses(self, reply: Reply) -> bool:
        return bool(reply.error & self.refusals)

    def _accepts(self, data_size: int) -> bool:
        return data_size == self.data_size or data_size in self.other_sizes or (data_size == 0 and self.refusals > 0)

    def _accept(self, reply: Reply, frame_size: int, replies: list[Reply]) -> int:
        """Add a valid reply to ``replies``. Return the number of bytes consumed."""
        if not (reply.data or self.refuses(reply)):  # an acknowledgment, which is never expected in a group read
            return self._skip()
        replies.append(reply)
        self.garbage = 0
        return frame_size

    @abstractmethod
    def _decode(self, pending: bytes, at: int, replies: list[Reply]) -> int | None:
        """Decode the frame whose header is at ``at``.

        Return the number of bytes consumed, or None if more bytes are needed.
        """

    def _skip(self, size: int = 1) -> int:
        """Count garbage bytes, one at a time by default, because a valid frame may begin inside a false frame."""
        self.garbage += size
        return size
