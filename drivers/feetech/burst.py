"""One sync read: ask several servos at once, wait for all their replies together, judge what came."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from drivers.bus import FaultKind, ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters, ServoCounters
from drivers.echo import Echo
from drivers.feetech import state, wire
from drivers.owed import OwedReplies
from drivers.port import Port

FIRST_REPLY_S: Final = 0.02
"""How long the first reply may take: a USB adapter's latency timer can be 16 ms."""
GAP_S: Final = 0.002
"""How long the next reply may take once replies come."""
TRIED_GAP_S: Final = 0.0015
"""How long a servo is waited for that did not answer the last time."""

Outcome = ServoState | FaultKind
BITS_PER_BYTE: Final = 10.0


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


class BurstReader:
    """Sync reads on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, echo: Echo, counters: BusCounters) -> None:
        self._port = port
        self._clock = clock
        self._echo = echo
        self._counters = counters
        self._owed = OwedReplies()
        self._accounts: dict[tuple[int, ...], list[ServoCounters]] = {}
        self._byte_s = BITS_PER_BYTE / port.baud
        self._busy_until_s = 0.0
        self._size, self._sent, self._sent_s = state.STATE_SIZE, b"", 0.0
        self.clean = False
        """Whether the last answer was whole, so that nothing can be left to throw away."""

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

    def send(self, packet: bytes) -> None:
        """A packet that nobody answers. Its echo, if there is one, is taken off the line at once."""
        self._port.write(packet)
        on_wire_s = len(packet) * self._byte_s
        self._busy_until_s = max(self._busy_until_s, self._clock.now()) + on_wire_s
        if self._echo.present:
            self._port.read(len(packet), self._busy_until_s + on_wire_s + GAP_S)

    def _first_data(self, expected: int, sent_s: float, deadline_s: float, firm: bool) -> bytes:
        """The whole burst if it comes in time, or else what there is of it."""
        gap_s = GAP_S if firm else TRIED_GAP_S
        patience_s = sent_s + expected * self._byte_s + gap_s
        data = self._port.read(expected, patience_s if patience_s < deadline_s else deadline_s)
        if data or not firm:
            return data
        data = self._port.read(1, min(sent_s + FIRST_REPLY_S, deadline_s))
        if not data:
            return data
        return data + self._port.read(
            expected - 1, min(self._clock.now() + expected * self._byte_s + GAP_S, deadline_s)
        )

    def _all_well(self, servo_ids: tuple[int, ...], states: dict[int, ServoState]) -> Mapping[int, ServoState]:
        if self._echo.present is None:
            self._echo.present = False
        accounts = self._accounts.get(servo_ids)
        if accounts is None:
            accounts = self._accounts[servo_ids] = [self._counters.of(i) for i in servo_ids]
        for account in accounts:
            account.replies += 1
        for servo_id, reading in states.items():
            if reading.alarms:
                self._counters.of(servo_id).alarms += 1
        return states

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

    def _wait_for(self, hearing: _Hearing, servo_ids: tuple[int, ...], gap_s: float, deadline_s: float) -> None:
        end_s = min(self._clock.now() + FIRST_REPLY_S + gap_s * len(servo_ids), deadline_s)  # however much noise
        while lacking := hearing.lacking(servo_ids):
            patience_s = self._clock.now() + lacking * self._byte_s + gap_s
            data = self._port.read(lacking, min(patience_s, end_s))
            if not data:
                return
            hearing.take(hearing.decoder.feed(data))

    def _judge(self, hearing: _Hearing) -> dict[int, Outcome]:
        """A value or a fault for everyone who was asked, each counted once."""
        outcome: dict[int, Outcome] = {}
        belated: dict[int, FaultKind] = {}
        for reply in hearing.replies:
            if len(reply.data) == hearing.size and reply.servo_id in hearing.servo_ids:
                self._counters.strange += reply.servo_id in outcome
                outcome[reply.servo_id] = state.state(reply.status, reply.data)
            elif counted_as := self._owed.settle(reply.servo_id, len(reply.data)):
                belated[reply.servo_id] = counted_as
            else:
                self._counters.strange += 1
        corrupt = _corrupt(hearing, self._counters)
        for servo_id in hearing.servo_ids:
            if servo_id not in outcome:
                outcome[servo_id] = "corrupt" if servo_id in corrupt else "late" if servo_id in belated else "silent"
        self._count(outcome, hearing.size, belated)
        return outcome

    def _count(self, outcome: dict[int, Outcome], size: int, belated: Mapping[int, FaultKind]) -> None:
        now_s = self._clock.now()
        for servo_id, what in outcome.items():
            account = self._counters.of(servo_id)
            if isinstance(what, ServoState):
                account.replies += 1
                account.alarms += bool(what.alarms)
            else:
                account.corrupt += what == "corrupt"
                account.silent += what != "corrupt"
                self._owed.owe(servo_id, size, now_s, "corrupt" if what == "corrupt" else "silent")
        for servo_id, counted_as in belated.items():
            self._counters.of(servo_id).came_late(counted_as)


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
