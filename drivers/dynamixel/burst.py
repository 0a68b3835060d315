"""One group read: ask several servos at once, wait for all their replies together, judge what came."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from drivers.burst import GAP_S, TRIED_GAP_S, Burst
from drivers.bus import ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.dynamixel import state, wire
from drivers.dynamixel.models import Series
from drivers.dynamixel.plan import Plan, fast_plan_for, plan_for
from drivers.echo import Echo
from drivers.owed import Missed
from drivers.port import Port
from drivers.readings import Outcome

LOG = logging.getLogger("servoloop.drivers")

FAST_TRIAL_S: Final = 0.005
"""How long the answer to the trial of a fast sync read may take beside its time on the wire."""
FAST_TRIES: Final = 5
"""After so many broken answers in a row there are no more fast sync reads."""


@dataclass(slots=True)
class _Hearing:
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


class BurstReader(Burst):
    """Group reads on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(
        self, port: Port, clock: Clock, echo: Echo, counters: BusCounters, series: Mapping[int, Series]
    ) -> None:
        """``series`` by ID, of all servos that will be asked; the caller calls ``replan`` when it changes it."""
        super().__init__(port, clock, echo, counters)
        self._series = series
        self._plans: dict[tuple[tuple[int, ...], int], Plan] = {}
        self._fast_plans: dict[tuple[int, ...], Plan | None] = {}
        self._broken_in_a_row = 0
        self._plan = plan_for((), {}, 0)
        self.fast = False
        """Whether the servos answer fast sync reads; ``try_fast`` finds out."""

    def replan(self) -> None:
        """What servos are has changed."""
        self._plans.clear()
        self._fast_plans.clear()

    def plan(self, servo_ids: tuple[int, ...], place: int = 0) -> Plan:
        """How these servos are asked for their block number ``place``."""
        plan = self._plans.get((servo_ids, place))
        if plan is None:
            plan = self._plans[servo_ids, place] = plan_for(servo_ids, self._series, place)
        return plan

    def fast_plan(self, servo_ids: tuple[int, ...]) -> Plan | None:
        """How to ask them by a fast sync read; None where they are not of one series that may know it."""
        if servo_ids not in self._fast_plans:
            kinds = {self._series[i] for i in servo_ids}
            kind = kinds.pop() if len(kinds) == 1 else None
            self._fast_plans[servo_ids] = fast_plan_for(servo_ids, kind) if kind and kind.fast_sync_read else None
        return self._fast_plans[servo_ids]

    def try_fast(self, servo_ids: tuple[int, ...]) -> None:
        """Ask servos that have just answered once more, fast, and remember whether they did.

        Not for a cycle: whoever does not know the instruction costs a wait. Nothing is counted. An adapter so
        slow that the answer does not come soon gets no fast reads: a silent first servo silences all, and
        would cost the slow adapter's whole wait in the cycle.
        """
        plan = self.fast_plan(servo_ids)
        if plan is None:
            return
        self._port.discard_input()
        self._port.write(plan.request)
        self.clean = False
        sent_s = max(self._busy_until_s, self._clock.now()) + len(plan.request) * self._byte_s
        expected = self._echo.expected(plan.request) + plan.reply_size
        data = self._port.read(expected, sent_s + expected * self._byte_s + FAST_TRIAL_S)
        self.fast = plan.states(self._echo.strip(plan.request, data)) is not None
        if not self.fast:
            LOG.info("%s: not every servo knows fast sync reads: their states by plain ones", self._port.name)

    def _free_plan(self, servo_ids: tuple[int, ...], now_s: float) -> Plan:
        """A question whose answers no late reply can be taken for."""
        if not self._owed:
            return self.plan(servo_ids)
        self._owed.forget(now_s)
        return self.plan(servo_ids, self._owed.free({i: self._series[i].state_sizes for i in servo_ids}))

    def read(self, firm: tuple[int, ...], tried: tuple[int, ...], deadline_s: float) -> Mapping[int, Outcome]:
        """``ask`` and ``hear``."""
        self.ask(firm, tried)
        return self.hear(firm, tried, deadline_s)

    def ask(self, firm: tuple[int, ...], tried: tuple[int, ...], before: bytes = b"", *, fast: bool = False) -> None:
        """Send the question. ``before``, a packet that nobody answers, goes out in one piece with it.

        ``firm`` are expected to answer; ``tried`` did not the last time, are asked after them and
        waited for shortly. ``fast`` allows a fast sync read, where one who is silent silences others too.
        """
        now_s = self._clock.now()
        begin_s = self._busy_until_s if self._busy_until_s > now_s else now_s
        plan = self._fast_or_none(firm, begin_s) if fast and self.fast else None
        self._plan = plan = plan or self._free_plan(firm + tried, begin_s)
        self._sent = sent = before + plan.request
        self._sent_s = begin_s + len(sent) * self._byte_s
        if not self.clean:
            self._port.discard_input()
        self.clean = False
        self._port.write(sent)

    def hear(self, firm: tuple[int, ...], tried: tuple[int, ...], deadline_s: float) -> Mapping[int, Outcome]:
        """The state of each servo that was asked, or what kind of fault there was."""
        plan, sent = self._plan, self._sent
        expected = self._echo.expected(sent) + (plan.bytes_from(firm) if firm and tried else plan.reply_size)
        data = self._first_data(expected, self._sent_s, deadline_s, bool(firm) and not plan.fast)
        if self._echo.present is not False:
            data = self._echo.strip(sent, data)
        states = plan.states(data)
        if plan.fast:
            return self._hear_fast(plan, states, data, deadline_s)
        if states is None:
            return self._listen_on(firm, tried, plan, data, deadline_s)
        self.clean = True
        return self._all_well(plan.servo_ids, states)

    def _fast_or_none(self, servo_ids: tuple[int, ...], now_s: float) -> Plan | None:
        """A fast sync read, unless a reply may still come late: only separate replies can be told apart."""
        if self._owed:
            self._owed.forget(now_s)
        return None if self._owed else self.fast_plan(servo_ids)

    def _hear_fast(
        self, plan: Plan, states: Mapping[int, ServoState] | None, data: bytes, deadline_s: float
    ) -> Mapping[int, Outcome]:
        """The whole packet, or what can be believed of it; never again after too many that were broken."""
        if states is not None:
            self.clean, self._broken_in_a_row = True, 0
            return self._all_well(plan.servo_ids, states)
        self._broken_in_a_row += 1
        if self._broken_in_a_row == FAST_TRIES:
            self.fast = False
            LOG.warning("%s: %d fast sync reads broken in a row: plain ones from now on", self._port.name, FAST_TRIES)
        return self._judge_fast(plan, data, deadline_s)

    def _judge_fast(self, plan: Plan, data: bytes, deadline_s: float) -> dict[int, Outcome]:
        """What can be believed of a packet that did not come as a whole; the caller asks for the rest again."""
        size = plan.sizes[plan.servo_ids[0]]
        piece = size + wire.FAST_OVERHEAD
        begin = data.find(wire.fast_head(len(plan.servo_ids), size))
        if begin > 0:  # behind noise, so as many bytes of it are still to come
            data += self._port.read(begin, min(self._clock.now() + begin * self._byte_s + GAP_S, deadline_s))
        outcome: dict[int, Outcome] = dict(plan.fast_states(data[begin:])) if begin >= 0 else {}
        garbage = len(data) - max(begin, 0) - len(outcome) * piece - wire.FAST_HEAD_SIZE
        for servo_id in plan.servo_ids[len(outcome) :]:
            corrupt = garbage > piece - piece // 2
            outcome[servo_id] = "corrupt" if corrupt else "silent"
            garbage -= piece if corrupt else 0
        self._counters.noise += (begin > 0) + (garbage > 0)
        self._count(outcome, plan.sizes, {})
        return outcome

    def _listen_on(
        self, firm: tuple[int, ...], tried: tuple[int, ...], plan: Plan, data: bytes, deadline_s: float
    ) -> dict[int, Outcome]:
        """Something is missing or there is garbage: piece by piece until the line falls silent."""
        size = min(plan.sizes.values())
        decoder = wire.ReplyDecoder(size, self._owed.sizes().union(plan.sizes.values()) - {size})
        hearing = _Hearing(plan, decoder)
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
            if hearing.fits(reply) and not reply.error & ~wire.ALERT:
                self._counters.strange += reply.servo_id in outcome
                outcome[reply.servo_id] = state.state(reply.error, reply.data, self._series[reply.servo_id])
            elif counted_as := self._owed.settle(reply.servo_id, len(reply.data)):
                belated[reply.servo_id] = counted_as
            else:
                self._counters.strange += 1
        corrupt = _corrupt(hearing, self._counters)
        self._missed(hearing.plan.servo_ids, outcome, corrupt, belated)
        self._count(outcome, hearing.plan.sizes, belated)
        return outcome


def _corrupt(hearing: _Hearing, counters: BusCounters) -> set[int]:
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


def _gaps(hearing: _Hearing) -> list[tuple[int, list[int]]]:
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
