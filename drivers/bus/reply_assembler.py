"""Collect separate replies to one request, and attribute garbage to the servos from whose replies it may come."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from drivers.protocol.decoder import Decoder, Reply


@dataclass(slots=True)
class ReplyAssembler:
    """Collector of replies. ``sizes`` holds the requested data size for each servo, in the order of the request."""

    sizes: Mapping[int, int]
    overhead: int
    """Number of bytes in a reply in addition to its data."""
    decoder: Decoder
    ambiguous: frozenset[int] = frozenset()
    """Servos whose rejection may belong to an earlier request. After such a rejection, the reply to this request may
    still arrive."""
    replies: list[Reply] = field(default_factory=list)
    answered: set[int] = field(default_factory=set)

    def feed(self, data: bytes) -> None:
        self._add(self.decoder.feed(data))

    def finish(self) -> None:
        self._add(self.decoder.finish())

    def _add(self, replies: Sequence[Reply]) -> None:
        self.replies += replies
        for reply in replies:
            if self.fits(reply) and not (reply.servo_id in self.ambiguous and self.decoder.refuses(reply)):
                self.answered.add(reply.servo_id)

    def fits(self, reply: Reply) -> bool:
        """Return whether the reply may belong to this request. The size of the reply must match, unless it is a
        rejection."""
        size = self.sizes.get(reply.servo_id)
        return size is not None and (len(reply.data) == size or self.decoder.refuses(reply))

    def bytes_missing(self, servo_ids: tuple[int, ...]) -> int:
        """Return the number of bytes to wait for, which is 0 once the last of these servos has replied."""
        if not servo_ids or servo_ids[-1] in self.answered:
            return 0
        missing = sum(self.sizes[i] + self.overhead for i in servo_ids if i not in self.answered)
        return max(1, missing - self.decoder.waiting)

    def corrupted(self) -> tuple[set[int], int]:
        """Return the servos whose corrupt replies explain the garbage, and the remaining number of noise sequences.

        Servos reply in the order of the request. The garbage between two replies is attributed to as many of the
        missing servos between them as would fit. Servos whose IDs are still readable in the garbage come first.
        """
        corrupt: set[int] = set()
        noise = 0
        if not self.decoder.garbage and not any(reply.garbage for reply in self.replies):
            return corrupt, noise
        for garbage, missing in self._gaps():
            for servo_id in sorted(missing, key=lambda i: i not in self.decoder.corrupt_ids):
                frame_size = self.sizes[servo_id] + self.overhead
                if garbage <= frame_size - frame_size // 2:
                    break
                corrupt.add(servo_id)
                garbage -= frame_size
            noise += garbage > 0
        return corrupt, noise

    def _gaps(self) -> list[tuple[int, list[int]]]:
        """Return the amount of garbage and the missing servos before each expected reply and after the last reply."""
        asked = tuple(self.sizes)
        gaps = []
        turn, garbage = 0, 0
        for reply in self.replies:
            garbage += reply.garbage
            if reply.servo_id in asked[turn:] and self.fits(reply):
                its_turn = asked.index(reply.servo_id)
                gaps.append((garbage, self._missing(asked[turn:its_turn])))
                turn, garbage = its_turn + 1, 0
        gaps.append((garbage + self.decoder.garbage, self._missing(asked[turn:])))
        return [gap for gap in gaps if gap[0]]

    def _missing(self, servo_ids: tuple[int, ...]) -> list[int]:
        return [i for i in servo_ids if i not in self.answered]
