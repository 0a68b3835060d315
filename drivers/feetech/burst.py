"""One sync read: ask several servos at once, wait for all their replies together, judge what came."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from drivers.burst import TRIED_GAP_S, Burst
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.echo import Echo
from drivers.feetech import state, wire
from drivers.owed import Missed
from drivers.port import Port
from drivers.readings import Outcome


@lru_cache(maxsize=256)
def _request(servo_ids: tuple[int, ...], size: int) -> bytes:
    return wire.sync_read(servo_ids, state.STATE_ADDRESS, size)


@dataclass(slots=True)
class _Hearing:
    """What has come of one burst that did not come as a whole."""

    servo_ids: tuple[int, ...]
    size: int
    decoder: wire.ReplyDecoder
    replies: list[wire.Reply] = field(default_factory=list)
    answered: set[int] = field(default_factory=set)

    def take(self, replies: Sequence[wire.Reply]) -> None:
        """Note who has answered."""
        self.replies += replies
        self.answered.update(r.servo_id for r in replies if len(r.data) == self.size)

    def lacking(self, servo_ids: tuple[int, ...]) -> int:
        """Bytes to wait for; 0 when the last of them has answered: nobody answers out of turn."""
        if not servo_ids or servo_ids[-1] in self.answered:
            return 0
        missing = sum(i not in self.answered for i in servo_ids)
        return max(1, missing * (self.size + wire.OVERHEAD) - self.decoder.waiting)


class BurstReader(Burst):
    """Sync reads on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, echo: Echo, counters: BusCounters) -> None:
        super().__init__(port, clock, echo, counters)
        self._size = state.STATE_SIZE

    def read(self, firm: tuple[int, ...], tried: tuple[int, ...], deadline_s: float) -> Mapping[int, Outcome]:
        """``ask`` and ``hear``."""
        self.ask(firm, tried)
        return self.hear(firm, tried, deadline_s)

    def ask(self, firm: tuple[int, ...], tried: tuple[int, ...]) -> None:
        """Send the question.

        ``firm`` are expected to answer; ``tried`` did not the last time, are asked after them and
        waited for shortly.
        """
        now_s = self._clock.now()
        begin_s = self._busy_until_s if self._busy_until_s > now_s else now_s
        self._size = size = self._free_size(firm + tried, begin_s) if self._owed else state.STATE_SIZE
        self._sent = sent = _request(firm + tried, size)
        self._sent_s = begin_s + len(sent) * self._byte_s
        if not self.clean:
            self._port.discard_input()
        self.clean = False
        self._port.write(sent)

    def _free_size(self, servo_ids: tuple[int, ...], now_s: float) -> int:
        self._owed.forget(now_s)
        return state.STATE_SIZES[self._owed.free(dict.fromkeys(servo_ids, state.STATE_SIZES))]

    def hear(
        self, firm: tuple[int, ...], tried: tuple[int, ...], deadline_s: float, after: bytes = b""
    ) -> Mapping[int, Outcome]:
        """The state of each servo that was asked, or what kind of fault there was.

        ``after``, a packet that nobody answers, goes out as soon as the replies are there: they are decoded
        while it is on the wire.
        """
        servo_ids, size, sent = firm + tried, self._size, self._sent
        expected = self._echo.expected(sent) + (size + wire.OVERHEAD) * len(firm or tried)
        data = self._first_data(expected, self._sent_s, deadline_s, bool(firm))
        if self._echo.present is not False:
            data = self._echo.strip(sent, data)
        elif after and len(data) == expected:
            self.send(after)
            after = b""
        states = state.burst(data, servo_ids, size)
        outcome: Mapping[int, Outcome]
        if states is None:
            outcome = self._listen_on(firm, tried, size, data, deadline_s)
        else:
            self.clean = True
            outcome = self._all_well(servo_ids, states)
        if after:
            self.send(after)
        return outcome

    def _listen_on(
        self, firm: tuple[int, ...], tried: tuple[int, ...], size: int, data: bytes, deadline_s: float
    ) -> dict[int, Outcome]:
        """Something is missing or there is garbage: piece by piece until the line falls silent."""
        decoder = wire.ReplyDecoder(size, self._owed.sizes() - {size})
        hearing = _Hearing(firm + tried, size, decoder)
        hearing.take(decoder.feed(data))
        if data:
            self._wait_for(hearing, firm, TRIED_GAP_S, deadline_s)  # the long wait is over
        if tried:
            self._wait_for(hearing, tried, TRIED_GAP_S, deadline_s)
        hearing.take(decoder.finish())
        return self._judge(hearing)

    def _judge(self, hearing: _Hearing) -> dict[int, Outcome]:
        """A value or a fault for everyone who was asked, each counted once."""
        outcome: dict[int, Outcome] = {}
        belated: dict[int, Missed] = {}
        for reply in hearing.replies:
            if len(reply.data) == hearing.size and reply.servo_id in hearing.servo_ids:
                self._counters.strange += reply.servo_id in outcome
                outcome[reply.servo_id] = state.state(reply.status, reply.data)
            elif counted_as := self._owed.settle(reply.servo_id, len(reply.data)):
                belated[reply.servo_id] = counted_as
            else:
                self._counters.strange += 1
        corrupt = _corrupt(hearing, self._counters)
        self._missed(hearing.servo_ids, outcome, corrupt, belated)
        self._count(outcome, dict.fromkeys(hearing.servo_ids, hearing.size), belated)
        return outcome


def _corrupt(hearing: _Hearing, counters: BusCounters) -> set[int]:
    """Whose reply lies in the garbage: replies come in turn, so the gap says who is missing in it.

    As many as fit into the garbage, those first whose ID can still be read. What is left over, or
    too little to be a reply, is noise.
    """
    frame_size = hearing.size + wire.OVERHEAD
    corrupt: set[int] = set()
    for garbage, missing in _gaps(hearing):
        likely = sorted(missing, key=lambda i: i not in hearing.decoder.corrupt_ids)
        count = min(len(likely), (garbage + frame_size // 2 - 1) // frame_size)
        corrupt.update(likely[:count])
        counters.noise += garbage > count * frame_size
    return corrupt


def _gaps(hearing: _Hearing) -> list[tuple[int, list[int]]]:
    """Garbage and missing servos before each reply that was asked for, and after the last."""
    gaps = []
    turn, garbage = 0, 0
    for reply in hearing.replies:
        garbage += reply.garbage
        if reply.servo_id not in hearing.servo_ids[turn:] or len(reply.data) != hearing.size:
            continue
        its_turn = hearing.servo_ids.index(reply.servo_id)
        gaps.append((garbage, [i for i in hearing.servo_ids[turn:its_turn] if i not in hearing.answered]))
        turn, garbage = its_turn + 1, 0
    rest = [i for i in hearing.servo_ids[turn:] if i not in hearing.answered]
    gaps.append((garbage + hearing.decoder.garbage, rest))
    return [gap for gap in gaps if gap[0]]
