"""What came after one question, and whose each piece of it is. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from drivers.feetech.wire import OVERHEAD, Reply, ReplyDecoder


@dataclass(slots=True)
class Hearing:
    """The replies of ``servo_ids``, with ``size`` bytes of data each, in their order, and garbage between."""

    servo_ids: tuple[int, ...]
    size: int
    decoder: ReplyDecoder
    replies: list[Reply] = field(default_factory=list)
    answered: set[int] = field(default_factory=set)

    def feed(self, data: bytes) -> None:
        """More bytes."""
        self._take(self.decoder.feed(data))

    def finish(self) -> None:
        """Nothing more comes."""
        self._take(self.decoder.finish())

    def _take(self, replies: Sequence[Reply]) -> None:
        self.replies += replies
        self.answered.update(reply.servo_id for reply in replies if self.wanted(reply))

    def wanted(self, reply: Reply) -> bool:
        """Whether it answers this question."""
        return len(reply.data) == self.size and reply.servo_id in self.servo_ids

    @property
    def frame_size(self) -> int:
        """Bytes of one reply."""
        return self.size + OVERHEAD

    @property
    def lacking(self) -> int:
        """Bytes to wait for; 0 when the last servo has answered: nobody answers out of turn."""
        if self.servo_ids[-1] in self.answered:
            return 0
        missing = sum(i not in self.answered for i in self.servo_ids)
        return max(1, missing * self.frame_size - self.decoder.waiting)

    def spoiled(self) -> tuple[set[int], int]:
        """Whose reply lies in the garbage, and how many pieces of garbage are too short or too long for that.

        Replies come in turn, so the gap says who is missing in it: as many as fit, those first whose ID
        can still be read.
        """
        corrupt: set[int] = set()
        noise = 0
        for garbage, missing in self._gaps():
            likely = sorted(missing, key=lambda i: i not in self.decoder.corrupt_ids)
            count = min(len(likely), (garbage + self.frame_size // 2 - 1) // self.frame_size)
            corrupt.update(likely[:count])
            noise += garbage > count * self.frame_size
        return corrupt, noise

    def _gaps(self) -> list[tuple[int, list[int]]]:
        """Garbage and missing servos before each wanted reply, and after the last."""
        gaps = []
        turn, garbage = 0, 0
        for reply in self.replies:
            garbage += reply.garbage
            if self.wanted(reply) and reply.servo_id in self.servo_ids[turn:]:
                its_turn = self.servo_ids.index(reply.servo_id)
                gaps.append((garbage, self._missing(turn, its_turn)))
                turn, garbage = its_turn + 1, 0
        gaps.append((garbage + self.decoder.garbage, self._missing(turn, len(self.servo_ids))))
        return [gap for gap in gaps if gap[0]]

    def _missing(self, begin: int, end: int) -> list[int]:
        return [i for i in self.servo_ids[begin:end] if i not in self.answered]
