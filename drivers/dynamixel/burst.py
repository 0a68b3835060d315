"""One group read: ask several servos at once, wait for all their replies together, judge what came."""

import logging
import math
from collections.abc import Mapping
from typing import Final

from drivers.burst import GAP_S, TRIED_GAP_S, Burst
from drivers.bus import ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.dynamixel import wire
from drivers.dynamixel.plan import Plan, Plans
from drivers.dynamixel.series import StateBlock
from drivers.dynamixel.servos import Servos
from drivers.echo import Echo
from drivers.hearing import Hearing
from drivers.port import Port
from drivers.readings import Outcome

LOG = logging.getLogger("servoloop.drivers")

FAST_TRIAL_S: Final = 0.005
"""How long the answer to the trial of a fast sync read may take beside its time on the wire."""
FAST_TRIES: Final = 5
"""After so many broken answers in a row there are no more fast sync reads."""


class BurstReader(Burst[wire.Reply]):
    """Group reads on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, echo: Echo, counters: BusCounters, servos: Servos) -> None:
        """``servos`` says what to ask each of."""
        super().__init__(port, clock, echo, counters)
        self._servos = servos
        self.plans = Plans(servos)
        self._broken_in_a_row = 0
        self._plan = self.plans.plan(())
        self._left = b""
        self.steady: Plan | None = None
        """What the last question was, where the answer was whole and every next one can be the same: nothing is owed,
        nothing is asked in a way of its own for that, and the line is known to give no echo."""
        self.fast = False
        """Whether the servos answer fast sync reads; ``try_fast`` finds out."""
        self.repeat_s = math.inf
        """How much time ``steady`` servos must have if they are to be asked fast."""

    @property
    def asked(self) -> Mapping[int, StateBlock]:
        """What the last question was for."""
        return self._plan.blocks

    def try_fast(self, servo_ids: tuple[int, ...]) -> None:
        """Ask servos that have just answered once more, fast, and remember whether they did.

        Not for a cycle: whoever does not know the instruction costs a wait. Nothing is counted. An adapter so
        slow that the answer does not come soon gets no fast reads: a silent first servo silences all, and
        would cost the slow adapter's whole wait in the cycle.
        """
        plan = self.plans.fast(servo_ids)
        if plan is None:
            return
        self._port.discard_input()
        self._port.write(plan.request)
        self.clean = False
        sent_s = max(self._busy_until_s, self._clock.now()) + len(plan.request) * self.byte_s
        expected = self._echo.expected(plan.request) + plan.reply_size
        data = self._port.read(expected, sent_s + expected * self.byte_s + FAST_TRIAL_S)
        self.fast = plan.states(self._echo.strip(plan.request, data)) is not None
        if not self.fast:
            LOG.info("%s: not every servo knows fast sync reads: their states by plain ones", self._port.name)

    def cycle(self, plan: Plan, before: bytes, deadline_s: float) -> Mapping[int, ServoState] | None:
        """``ask`` and ``hear``, while ``clean`` and ``steady``, the same on the wire; None where not all is well.

        Between two cycles the processor forgets this code: it takes few different steps. After None, ``recover``.
        """
        self.clean = False
        self._sent = sent = before + plan.request
        now_s = self._clock.now()
        begin_s = self._busy_until_s if self._busy_until_s > now_s else now_s
        self._sent_s = sent_s = begin_s + len(sent) * self.byte_s
        self._port.write(sent)
        patience_s = sent_s + plan.reply_size * self.byte_s + GAP_S
        self._left = data = self._port.read(plan.reply_size, patience_s if patience_s < deadline_s else deadline_s)
        states = plan.states(data)
        if states is None:
            return None
        self.clean = True
        return self._all_well(plan.servo_ids, states)

    def recover(self, plan: Plan, deadline_s: float) -> Mapping[int, Outcome]:
        """What there is in an answer that did not come as it should, and what comes behind it."""
        data = self._left
        if not data and not plan.fast:
            data = self._after_silence(plan.reply_size, self._sent_s, deadline_s)
        return self._understand(plan.servo_ids, (), data, deadline_s)

    def _free_plan(self, servo_ids: tuple[int, ...], now_s: float) -> Plan:
        """A question whose answers no late reply can be taken for."""
        if not self._owed:
            return self.plans.plan(servo_ids)
        self._owed.forget(now_s)
        sizes = {i: [block.size for block in self._servos.blocks(i)] for i in servo_ids}
        return self.plans.plan(servo_ids, self._owed.free(sizes))

    def read(self, firm: tuple[int, ...], tried: tuple[int, ...], deadline_s: float) -> Mapping[int, Outcome]:
        """``ask`` and ``hear``."""
        self.ask(firm, tried)
        return self.hear(firm, tried, deadline_s)

    def ask(
        self, firm: tuple[int, ...], tried: tuple[int, ...], before: bytes = b"", fast_until_s: float = -math.inf
    ) -> None:
        """Send the question. ``before``, a packet that nobody answers, goes out in one piece with it.

        ``firm`` are expected to answer; ``tried`` did not the last time, are asked after them and
        waited for shortly. A fast sync read, where one who is silent silences others too, is made if until
        ``fast_until_s`` all can be asked once more.
        """
        now_s = self._clock.now()
        begin_s = self._busy_until_s if self._busy_until_s > now_s else now_s
        plan = self._fast_or_none(firm, begin_s, fast_until_s) if self.fast else None
        self._plan = plan = plan or self._free_plan(firm + tried, begin_s)
        self._sent = sent = before + plan.request
        self._sent_s = begin_s + len(sent) * self.byte_s
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
            until_s = min(self._sent_s + expected * self.byte_s + GAP_S, deadline_s)
            data = self._behind_echo(sent, data, expected, until_s)
        return self._understand(firm, tried, data, deadline_s)

    def _understand(
        self, firm: tuple[int, ...], tried: tuple[int, ...], data: bytes, deadline_s: float
    ) -> Mapping[int, Outcome]:
        """What the first bytes say, and those that come behind them."""
        plan, self.steady = self._plan, None
        states = None if self._owed.doubtful(plan.sizes) else plan.states(data)
        if states is not None:
            self.clean = True
            self._owed.answered(plan.servo_ids)
            if plan.fast:
                self._broken_in_a_row = 0
            states = self._all_well(plan.servo_ids, states)
            self._look_whether_steady(plan)
            return states
        if plan.fast:
            return self._hear_broken(plan, data, deadline_s)
        size = min(plan.sizes.values())
        decoder = wire.ReplyDecoder(size, self._owed.sizes().union(plan.sizes.values()) - {size})
        return self._listen_on(
            Hearing(plan.sizes, wire.OVERHEAD, decoder, self._doubted()), firm, tried, data, deadline_s
        )

    def _look_whether_steady(self, plan: Plan) -> None:
        """Whether a cycle asks them like this as long as all is well."""
        fast = self.plans.fast(plan.servo_ids) if self.fast else None
        if not self._owed and self._echo.present is False and plan in (fast, self.plans.plan(plan.servo_ids)):
            self.steady = plan
            self.repeat_s = self._repeat_s(fast) if fast else math.inf

    def forsake(self) -> None:
        """``give_up`` the last question."""
        self.give_up(self._plan.sizes)

    def _fast_or_none(self, servo_ids: tuple[int, ...], now_s: float, until_s: float) -> Plan | None:
        """A fast sync read, unless a reply may still come late: only separate replies can be told apart."""
        if self._owed:
            self._owed.forget(now_s)
        plan = None if self._owed else self.plans.fast(servo_ids)
        return plan if plan and now_s + self._repeat_s(plan) <= until_s else None

    def _repeat_s(self, fast: Plan) -> float:
        """What a fast sync read in vain takes, and then a plain one."""
        plain = self.plans.plan(fast.servo_ids)
        size = len(fast.request) + fast.reply_size + len(plain.request) + plain.reply_size
        return size * self.byte_s + GAP_S + TRIED_GAP_S

    def _hear_broken(self, plan: Plan, data: bytes, deadline_s: float) -> Mapping[int, Outcome]:
        """What can be believed of a fast sync read's packet; no more of these after too many that were broken."""
        outcome = self._judge_fast(plan, data, deadline_s)
        self._broken_in_a_row += bool({"silent", "corrupt"} & set(outcome.values()))
        if self._broken_in_a_row == FAST_TRIES:
            self.fast = False
            LOG.warning("%s: %d fast sync reads broken in a row: plain ones from now on", self._port.name, FAST_TRIES)
        return outcome

    def _judge_fast(self, plan: Plan, data: bytes, deadline_s: float) -> dict[int, Outcome]:
        """What can be believed of a packet that did not come as a whole; the caller asks for the rest again."""
        size = plan.sizes[plan.servo_ids[0]]
        piece = size + wire.FAST_OVERHEAD
        begin = data.find(wire.fast_head(len(plan.servo_ids), size))
        if begin > 0:  # behind noise, so as many bytes of it are still to come
            data += self._port.read(begin, min(self._clock.now() + begin * self.byte_s + GAP_S, deadline_s))
        outcome = plan.fast_outcome(data[begin:]) if begin >= 0 else {}
        garbage = len(data) - max(begin, 0) - len(outcome) * piece - wire.FAST_HEAD_SIZE
        for servo_id in plan.servo_ids[len(outcome) :]:
            corrupt = garbage > piece - piece // 2
            outcome[servo_id] = "corrupt" if corrupt else "silent"
            garbage -= piece if corrupt else 0
        self._counters.noise += (begin > 0) + (garbage > 0)
        self._count(outcome, plan.sizes, ())
        return outcome

    def _said(self, reply: wire.Reply) -> Outcome:
        plan, servo_id = self._plan, reply.servo_id
        return plan.blocks[servo_id].outcome(servo_id, reply.error, reply.data, plan.units_a[servo_id])
