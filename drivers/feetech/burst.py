"""One sync read: ask several servos at once, wait for all their replies together, judge what came."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from drivers.burst import Burst
from drivers.bus import ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters, WholeBursts
from drivers.echo import Echo
from drivers.feetech import state, wire
from drivers.hearing import Hearing
from drivers.port import Port
from drivers.readings import Outcome

STEADY_GAP_S: Final = 0.004
"""How long after its time an answer may still come that has always come so far. Not less than a tick of most kernels:
each piece of an answer wakes us, and to sleep on until before the next tick costs two settings of the clock's timer."""


@lru_cache(maxsize=256)
def _request(servo_ids: tuple[int, ...], size: int) -> bytes:
    return wire.sync_read(servo_ids, state.STATE_ADDRESS, size)


class Steady:
    """What a cycle must know of the servos that have all answered the last question, looked up once.

    Times in seconds from the moment of the question, when the last cycle's goals may still be on the wire.
    """

    __slots__ = ("layout", "patience_s", "question", "sent_s", "servo_ids", "whole_bursts")

    def __init__(self, servo_ids: tuple[int, ...], byte_s: float, whole_bursts: WholeBursts) -> None:
        self.servo_ids = servo_ids
        self.question = _request(servo_ids, state.STATE_SIZE)
        self.layout = state.layout(servo_ids, state.STATE_SIZE)
        self.whole_bursts = whole_bursts
        goals_s = state.goals_size(len(servo_ids)) * byte_s
        self.sent_s = goals_s + len(self.question) * byte_s
        self.patience_s = self.sent_s + self.layout.size * byte_s + STEADY_GAP_S


class BurstReader(Burst[wire.Reply]):
    """Sync reads on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, echo: Echo, counters: BusCounters) -> None:
        super().__init__(port, clock, echo, counters)
        self._size = state.STATE_SIZE
        self._left = 0.0, b"", b""
        self._steady: dict[tuple[int, ...], Steady] = {}
        self.steady: Steady | None = None
        """Of whom the last answer was whole, while nothing is owed and the line is known to give no echo."""

    def cycle(self, steady: Steady, goals: bytes, deadline_s: float) -> dict[int, ServoState] | None:
        """``ask`` and ``hear``, while ``clean`` and ``steady``, the same on the wire; None where not all is well.

        Between two cycles the processor forgets this code: what makes a cycle cheap is how few different steps it
        takes, not how often. After None, ``recover`` must be called.
        """
        self.clean = False
        self._port.write(steady.question)
        now_s = self._clock.now()
        patience_s = now_s + steady.patience_s
        layout = steady.layout
        data = self._port.read(layout.size, patience_s if patience_s < deadline_s else deadline_s)
        if data.startswith(layout.last_head, layout.last_at) and len(data) == layout.size:
            self._port.write(goals)
            states, alarms = layout.states(data)
            if states is not None:
                self.clean = True
                steady.whole_bursts.count += 1
                if alarms:
                    self._count_alarms(states)
                return states
            self._busy_until_s = self._clock.now() + len(goals) * self.byte_s
            goals = b""
        self._left = now_s + steady.sent_s, data, goals
        return None

    def recover(self, steady: Steady, deadline_s: float) -> Mapping[int, Outcome]:
        """What there is in an answer that did not come as it should, and what comes behind it; then the goals."""
        sent_s, data, goals = self._left
        if not data:
            data = self._after_silence(steady.layout.size, sent_s, deadline_s)
        return self._understand(steady.servo_ids, (), state.STATE_SIZE, data, goals, deadline_s)

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
        self._sent_s = begin_s + len(sent) * self.byte_s
        if not self.clean:
            self._port.discard_input()
        self.clean = False
        self._port.write(sent)

    def forsake(self, servo_ids: tuple[int, ...]) -> None:
        """``give_up`` the last question."""
        self.give_up(dict.fromkeys(servo_ids, self._size))

    def _free_size(self, servo_ids: tuple[int, ...], now_s: float) -> int:
        self._owed.forget(now_s)
        return state.STATE_SIZES[self._owed.free(dict.fromkeys(servo_ids, state.STATE_SIZES))]

    def hear(
        self, firm: tuple[int, ...], tried: tuple[int, ...], deadline_s: float, after: bytes = b""
    ) -> Mapping[int, Outcome]:
        """The state of each servo that was asked, or what kind of fault there was.

        ``after``, a packet that nobody answers, goes out as soon as all replies are there: they are decoded
        while it is on the wire.
        """
        size, sent = self._size, self._sent
        expected = self._echo.expected(sent) + (size + wire.OVERHEAD) * len(firm or tried)
        data = self._first_data(expected, self._sent_s, deadline_s, bool(firm))
        if self._echo.present is not False:
            data = self._echo.strip(sent, data)
        elif after and not tried and self._is_all(data, state.layout(firm, size)):
            self.send(after)
            after = b""
        return self._understand(firm, tried, size, data, after, deadline_s)

    @staticmethod
    def _is_all(data: bytes, layout: state.BurstLayout) -> bool:
        """Whether nobody speaks any more. What is sent while somebody does is lost, and the answer too."""
        return len(data) == layout.size and data.startswith(layout.last_head, layout.last_at)

    def _understand(
        self, firm: tuple[int, ...], tried: tuple[int, ...], size: int, data: bytes, after: bytes, deadline_s: float
    ) -> Mapping[int, Outcome]:
        """What the first bytes say, and those that come behind them; then ``after`` goes out."""
        servo_ids = firm + tried
        sizes = dict.fromkeys(servo_ids, size)
        states = None if self._owed.doubtful(sizes) else state.burst(data, servo_ids, size)
        outcome: Mapping[int, Outcome]
        self.steady = None
        if states is None:
            hearing = Hearing(sizes, wire.OVERHEAD, wire.ReplyDecoder(size, self._owed.sizes() - {size}))
            outcome = self._listen_on(hearing, firm, tried, data, deadline_s)
        else:
            self.clean = True
            self._owed.answered(servo_ids)
            outcome = self._all_well(servo_ids, states)
            if not self._owed and self._echo.present is False:
                self.steady = self._steady_with(servo_ids)
        if after:
            self.send(after)
        return outcome

    def _steady_with(self, servo_ids: tuple[int, ...]) -> Steady:
        found = self._steady.get(servo_ids)
        if found is None:
            found = self._steady[servo_ids] = Steady(servo_ids, self.byte_s, self._whole(servo_ids))
        return found

    def _said(self, reply: wire.Reply) -> Outcome:
        return state.state(reply.error, reply.data)
