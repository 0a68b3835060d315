"""What came of one burst that did not come as a whole: who answered, and in whose place there is garbage."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from drivers.counters import BusCounters
from drivers.dynamixel import wire
from drivers.dynamixel.plan import Plan


@dataclass(slots=True)
class Hearing:
    """What has come of one burst that did not come as a whole."""

    plan: Plan
    decoder: wire.ReplyDecoder
    replies: list[wire.Reply] = field(default_factory=list)
    answered: set[int] = field(default_factory=set)

    def take(self, replies: Sequence[wire.Reply]) -> None:
        """Note who has answered."""
        self.replies += replies
        self.answered.update(r.servo_id for r in replies if self.fits(r))

    def fits(self, reply: wire.Reply) -> bool:
        """Whether the reply is one to this question, by its size."""
        return len(reply.data) == self.plan.sizes.get(reply.servo_id)

    def lacking(self, servo_ids: tuple[int, ...]) -> int:
        """Bytes to wait for; 0 when the last of them has answered: nobody answers out of turn."""
        if not servo_ids or servo_ids[-1] in self.answered:
            return 0
        missing = tuple(i for i in servo_ids if i not in self.answered)
        return max(1, self.plan.bytes_from(missing) - self.decoder.waiting)


def corrupt_ones(hearing: Hearing, counters: BusCounters) -> set[int]:
    """Whose reply lies in the garbage: replies come in turn, so the gap says who is missing in it.

    As many as fit into the garbage, those first whose ID can still be read. What is left over, or
    too little to be a reply, is noise.
    """
    corrupt: set[int] = set()
    for garbage, missing in _gaps(hearing):
        for servo_id in sorted(missing, key=lambda i: i not in hearing.decoder.corrupt_ids):
            frame_size = hearing.plan.sizes[servo_id] + wire.OVERHEAD
            if garbage <= frame_size - frame_size // 2:
                break
            corrupt.add(servo_id)
            garbage -= frame_size
        counters.noise += garbage > 0
    return corrupt


def _gaps(hearing: Hearing) -> list[tuple[int, list[int]]]:
    """Garbage and missing servos before each reply that was asked for, and after the last."""
    gaps = []
    turn, garbage, asked = 0, 0, hearing.plan.servo_ids
    for reply in hearing.replies:
        garbage += reply.garbage
        if reply.servo_id not in asked[turn:] or not hearing.fits(reply):
            continue
        its_turn = asked.index(reply.servo_id)
        gaps.append((garbage, [i for i in asked[turn:its_turn] if i not in hearing.answered]))
        turn, garbage = its_turn + 1, 0
    rest = [i for i in asked[turn:] if i not in hearing.answered]
    gaps.append((garbage + hearing.decoder.garbage, rest))
    return [gap for gap in gaps if gap[0]]
