"""What bursts of replies have in common, whatever the packets: sending, waiting, judging, counting."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Final, Generic

from drivers.bus import ServoFault, ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters, WholeBursts
from drivers.decoder import ReplyT
from drivers.echo import Echo
from drivers.hearing import Hearing
from drivers.owed import Missed, OwedReplies
from drivers.port import Port
from drivers.readings import Outcome

FIRST_REPLY_S: Final = 0.02
"""How long the first reply may take: a USB adapter's latency timer can be 16 ms."""
GAP_S: Final = 0.002
"""How long the next reply may take once replies come."""
TRIED_GAP_S: Final = 0.0015
"""How long a servo is waited for that did not answer the last time."""
BITS_PER_BYTE: Final = 10.0

_ALARMS_OF: Final = attrgetter("alarms")


class Burst(ABC, Generic[ReplyT]):
    """One port's bursts. Counts what goes wrong; raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, echo: Echo, counters: BusCounters) -> None:
        self._port = port
        self._clock = clock
        self._echo = echo
        self._counters = counters
        self._owed = OwedReplies()
        self.single_until_s: dict[int, float] = {}
        """Until when the answer to a question to one servo alone may come, by servo (drivers/questions.py)."""
        self._whole_bursts: dict[tuple[int, ...], WholeBursts] = {}
        self.byte_s = BITS_PER_BYTE / port.baud
        self._busy_until_s = 0.0
        self._sent, self._sent_s = b"", 0.0
        self.clean = False
        """Whether the last answer was whole, so that nothing can be left to throw away."""

    def send(self, packet: bytes) -> None:
        """A packet that nobody answers. Its echo, if there is one, is taken off the line at once."""
        self._port.write(packet)
        on_wire_s = len(packet) * self.byte_s
        self._busy_until_s = max(self._busy_until_s, self._clock.now()) + on_wire_s
        if self._echo.present:
            self._port.read(len(packet), self._busy_until_s + on_wire_s + GAP_S)

    def _first_data(self, expected: int, sent_s: float, deadline_s: float, firm: bool) -> bytes:
        """The whole burst if it comes in time, or else what there is of it."""
        gap_s = GAP_S if firm else TRIED_GAP_S
        patience_s = sent_s + expected * self.byte_s + gap_s
        data = self._port.read(expected, patience_s if patience_s < deadline_s else deadline_s)
        return data if data or not firm else self._after_silence(expected, sent_s, deadline_s)

    def _after_silence(self, expected: int, sent_s: float, deadline_s: float) -> bytes:
        """The adapter may be a slow one."""
        data = self._port.read(1, min(sent_s + FIRST_REPLY_S, deadline_s))
        if not data:
            return data
        return data + self._port.read(expected - 1, min(self._clock.now() + expected * self.byte_s + GAP_S, deadline_s))

    def _behind_echo(self, sent: bytes, data: bytes, expected: int, until_s: float) -> bytes:
        """The answer, of which so many bytes are expected, without our own bytes before it."""
        if self._echo.present is None and data and sent.startswith(data):
            # Nobody knew of an echo, and it is so long that there is nothing else yet.
            data += self._port.read(len(sent) - len(data) + expected, until_s)
        return self._echo.strip(sent, data)

    def _all_well(self, servo_ids: tuple[int, ...], states: Mapping[int, ServoState]) -> Mapping[int, ServoState]:
        if self._echo.present is None:
            self._echo.present = False
        self._whole(servo_ids).count += 1
        if any(map(_ALARMS_OF, states.values())):
            self._count_alarms(states)
        return states

    def _whole(self, servo_ids: tuple[int, ...]) -> WholeBursts:
        bursts = self._whole_bursts.get(servo_ids)
        if bursts is None:
            bursts = self._whole_bursts[servo_ids] = self._counters.whole_bursts(servo_ids)
        return bursts

    def _count_alarms(self, states: Mapping[int, ServoState]) -> None:
        for servo_id, reading in states.items():
            self._counters.of(servo_id).alarms += bool(reading.alarms)

    def _listen_on(
        self, hearing: Hearing[ReplyT], firm: tuple[int, ...], tried: tuple[int, ...], data: bytes, deadline_s: float
    ) -> dict[int, Outcome]:
        """Something is missing or there is garbage: piece by piece until the line falls silent."""
        hearing.feed(data)
        if data:
            self._wait_for(hearing, firm, deadline_s)
        if tried:
            self._wait_for(hearing, tried, deadline_s)
        hearing.finish()
        return self._judge(hearing)

    def _wait_for(self, hearing: Hearing[ReplyT], servo_ids: tuple[int, ...], deadline_s: float) -> None:
        """Each gap shortly: the long wait is over."""
        # However much noise there is.
        end_s = min(self._clock.now() + FIRST_REPLY_S + TRIED_GAP_S * len(servo_ids), deadline_s)
        while lacking := hearing.lacking(servo_ids):
            patience_s = self._clock.now() + lacking * self.byte_s + TRIED_GAP_S
            data = self._port.read(lacking, min(patience_s, end_s))
            if not data:
                return
            hearing.feed(data)

    def _judge(self, hearing: Hearing[ReplyT]) -> dict[int, Outcome]:
        """A value or a fault for everyone who was asked, each counted once."""
        outcome: dict[int, Outcome] = {}
        belated: list[tuple[int, Missed]] = []
        for reply in hearing.replies:
            if counted_as := self._owed.settle(reply.servo_id, len(reply.data), hearing.fits(reply)):
                belated.append((reply.servo_id, counted_as))
                continue
            what = self._said(reply) if hearing.fits(reply) else None
            self._counters.strange += what is None or reply.servo_id in outcome
            if what is not None:
                outcome[reply.servo_id] = what
                if not isinstance(what, ServoFault):  # a refusal may be that of an earlier question
                    self._owed.answered((reply.servo_id,))
        corrupt, noise = hearing.spoiled()
        self._counters.noise += noise
        late = {servo_id for servo_id, _ in belated}
        for servo_id in hearing.sizes:
            if servo_id not in outcome:
                outcome[servo_id] = "corrupt" if servo_id in corrupt else "late" if servo_id in late else "silent"
        self._count(outcome, hearing.sizes, belated)
        return outcome

    def _doubted(self) -> frozenset[int]:
        """Whose refusal may be that of an earlier question: it has no length to tell it by."""
        now_s = self._clock.now()
        return self._owed.servos() | {i for i, until_s in self.single_until_s.items() if until_s > now_s}

    def give_up(self, sizes: Mapping[int, int]) -> None:
        """Nobody will wait for these answers (bytes by servo), which are still on their way."""
        outcome: dict[int, Outcome] = dict.fromkeys(sizes, "silent")
        self._count(outcome, sizes, ())

    @abstractmethod
    def _said(self, reply: ReplyT) -> Outcome | None:
        """What a reply to this question says; None if it is none after all."""

    def _count(
        self, outcome: Mapping[int, Outcome], sizes: Mapping[int, int], belated: Sequence[tuple[int, Missed]]
    ) -> None:
        """Each question once. ``sizes``: the bytes that each was asked for."""
        now_s = self._clock.now()
        for servo_id, what in outcome.items():
            account = self._counters.of(servo_id)
            if isinstance(what, ServoState):
                account.single_replies += 1
                account.alarms += bool(what.alarms)
            elif what == "reset":  # it has answered, and owes nothing
                account.reset += 1
            elif isinstance(what, ServoFault):
                account.refused += 1
                if servo_id in self._doubted():
                    self._owed.owe(servo_id, sizes[servo_id], now_s, "refused")
            else:
                missed: Missed = "corrupt" if what == "corrupt" else "silent"
                account.missed(missed)
                self._owed.owe(servo_id, sizes[servo_id], now_s, missed)
        for servo_id, counted in belated:
            self._counters.of(servo_id).came_late(counted)
