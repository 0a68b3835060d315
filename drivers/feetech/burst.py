"""One sync read: ask several servos at once, wait for all their replies together, judge what came."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from drivers.burst import Burst
from drivers.clock import Clock
from drivers.counters import BusCounters
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


@lru_cache(maxsize=64)
def _question(servo_ids: tuple[int, ...], byte_s: float) -> tuple[bytes, int, float, float]:
    """The question and the size of its answer; how long both take on the wire, the answer with patience."""
    sent = _request(servo_ids, state.STATE_SIZE)
    expected = (state.STATE_SIZE + wire.OVERHEAD) * len(servo_ids)
    return sent, expected, len(sent) * byte_s, expected * byte_s + STEADY_GAP_S


class BurstReader(Burst[wire.Reply]):
    """Sync reads on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, echo: Echo, counters: BusCounters) -> None:
        super().__init__(port, clock, echo, counters)
        self._size = state.STATE_SIZE
        self._expected, self._patience_s = 0, 0.0
        self.steady = False
        """Whether the last answer was whole, nothing is owed, and the line is known to give no echo."""

    def ask_all(self, servo_ids: tuple[int, ...], deadline_s: float) -> None:
        """``ask``, only while ``clean`` and ``steady``, and before ``hear_all``; the same on the wire.

        Between two cycles the processor forgets this code: what it need not look at is what makes a cycle cheap.
        """
        self._sent, self._expected, sent_s, answer_s = _question(servo_ids, self.byte_s)
        self._size = state.STATE_SIZE
        now_s = self._clock.now()
        self._sent_s = sent_s = sent_s + (self._busy_until_s if self._busy_until_s > now_s else now_s)
        patience_s = sent_s + answer_s
        self._patience_s = patience_s if patience_s < deadline_s else deadline_s
        self.clean = False
        self._port.write(self._sent)

    def hear_all(self, servo_ids: tuple[int, ...], goals: bytes, deadline_s: float) -> Mapping[int, Outcome]:
        """``hear``: the states, and ``goals`` sent as soon as the replies are there."""
        data = self._port.read(self._expected, self._patience_s)
        if len(data) == self._expected:
            self._port.write(goals)
            self._busy_until_s = self._clock.now() + len(goals) * self.byte_s
            states = state.burst(data, servo_ids, state.STATE_SIZE)
            if states is not None:
                self.clean = True
                return self._all_well(servo_ids, states)
            goals = b""
        elif not data:
            data = self._after_silence(self._expected, self._sent_s, deadline_s)
        return self._understand(servo_ids, (), state.STATE_SIZE, data, goals, deadline_s)

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
        size, sent = self._size, self._sent
        expected = self._echo.expected(sent) + (size + wire.OVERHEAD) * len(firm or tried)
        data = self._first_data(expected, self._sent_s, deadline_s, bool(firm))
        if self._echo.present is not False:
            data = self._echo.strip(sent, data)
        elif after and len(data) == expected:
            self.send(after)
            after = b""
        return self._understand(firm, tried, size, data, after, deadline_s)

    def _understand(
        self, firm: tuple[int, ...], tried: tuple[int, ...], size: int, data: bytes, after: bytes, deadline_s: float
    ) -> Mapping[int, Outcome]:
        """What the first bytes say, and those that come behind them; then ``after`` goes out."""
        servo_ids = firm + tried
        states = state.burst(data, servo_ids, size)
        outcome: Mapping[int, Outcome]
        self.steady = False
        if states is None:
            decoder = wire.ReplyDecoder(size, self._owed.sizes() - {size})
            hearing = Hearing(dict.fromkeys(servo_ids, size), wire.OVERHEAD, decoder)
            outcome = self._listen_on(hearing, firm, tried, data, deadline_s)
        else:
            self.clean = True
            outcome = self._all_well(servo_ids, states)
            self.steady = not self._owed and self._echo.present is False
        if after:
            self.send(after)
        return outcome

    def _said(self, reply: wire.Reply) -> Outcome:
        return state.state(reply.status, reply.data)
