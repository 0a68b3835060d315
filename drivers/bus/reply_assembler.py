"""The replies to one question that did not come as a whole: which servos answered, in whose place is garbage. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from drivers.protocol.decoder import Decoder, Reply


@dataclass(slots=True)
class ReplyAssembler:
    """Collects the replies of some servos. ``sizes``: the data that each was asked for, in the question's order."""

    sizes: Mapping[int, int]
    overhead: int
    """Bytes of a reply beside its data."""
    decoder: Decoder
    doubted: frozenset[int] = frozenset()
    """Servos whose refusal ends nothing: it may be that of an earlier question, and this one's answer on its way."""
    replies: list[Reply] = field(default_factory=list)
    answered: set[int] = field(default_factory=set)

    def feed(self, data: bytes) -> None:
        """Take more bytes."""
        self._take(self.decoder.feed(data))

    def finish(self) -> None:
        """Take what waited for its end: nothing more comes."""
        self._take(self.decoder.finish())

    def _take(self, replies: Sequence[Reply]) -> None:
        self.replies += replies
        for reply in replies:
            if self.fits(reply) and not (reply.servo_id in self.doubted and self.decoder.refuses(reply)):
                self.answered.add(reply.servo_id)

    def fits(self, reply: Reply) -> bool:
        """Whether the reply is one to this question, by its size; one that refuses it may be of any."""
        size = self.sizes.get(reply.servo_id)
        return size is not None and (len(reply.data) == size or self.decoder.refuses(reply))

    def bytes_missing(self, servo_ids: tuple[int, ...]) -> int:
        """Bytes to wait for; 0 when the last of them has answered."""
        if not servo_ids or servo_ids[-1] in self.answered:
            return 0
        missing = sum(self.sizes[i] + self.overhead for i in servo_ids if i not in self.answered)
        return max(1, missing - self.decoder.waiting)

    def corrupted(self) -> tuple[set[int], int]:
        """The servos whose reply lies in the garbage, and how many pieces of it are too short or too long for that.

        Replies come in turn, so the gap says who is missing in it: as many as fit, those first whose ID
        can still be read.
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
        """Garbage and missing servos before each reply that was asked for, and after the last."""
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
