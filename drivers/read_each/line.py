"""One question and its answers on the line: asked, waited for, judged, counted."""

from collections.abc import Mapping, Sequence
from typing import Final

from drivers.burst import BITS_PER_BYTE
from drivers.bus import ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.echo import Echo
from drivers.feetech import wire
from drivers.owed import Missed, OwedReplies
from drivers.port import Port
from drivers.read_each.hearing import Hearing
from drivers.read_each.patience import FIRM_S, FIRST_REPLY_S, SPARE_S, Patience
from drivers.read_each.series import Series, StateOf
from drivers.readings import Outcome
from drivers.turns import Steps

READ: Final = 0x02
BULK_READ: Final = 0x92
RETRY_GAP_S: Final = 0.0015
"""How long more bytes may take once some have come."""


def read_packet(servo_id: int, address: int, size: int) -> bytes:
    """Asks one servo for ``size`` bytes at ``address``."""
    return wire.packet(servo_id, READ, bytes((address, size)))


def bulk_packet(servo_ids: tuple[int, ...], address: int, size: int) -> bytes:
    """Asks several for them in turn."""
    asked = b"".join(bytes((size, servo_id, address)) for servo_id in servo_ids)
    return wire.packet(wire.BROADCAST_ID, BULK_READ, b"\0" + asked)


class Line:
    """Reads of the state on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(
        self,
        port: Port,
        clock: Clock,
        echo: Echo,
        counters: BusCounters,
        series: Series,
        state_of: Mapping[int, StateOf],
    ) -> None:
        self._port = port
        self._clock = clock
        self._echo = echo
        self._counters = counters
        self._address = series.state_address
        self._state_of = state_of
        self._owed = OwedReplies()
        self._sizes = series.state_sizes
        self._largest = max(series.state_sizes)
        self.byte_s = BITS_PER_BYTE / port.baud
        self._busy_until_s = 0.0
        self.patience = Patience()
        self.clean = False
        """Whether the last answer was whole, so that nothing can be left to throw away."""

    def question(self, servo_ids: tuple[int, ...], size: int) -> bytes:
        """A read for one servo, a bulk read for several."""
        if len(servo_ids) == 1:
            return read_packet(servo_ids[0], self._address, size)
        return bulk_packet(servo_ids, self._address, size)

    def send(self, packet: bytes) -> None:
        """A packet that nobody answers. Its echo, if there is one, is taken off the line at once."""
        self._port.write(packet)
        on_wire_s = len(packet) * self.byte_s
        self._busy_until_s = max(self._busy_until_s, self._clock.now()) + on_wire_s
        if self._echo.present:
            self._port.read(len(packet), self._busy_until_s + on_wire_s + FIRM_S)

    def steps(
        self, servo_ids: tuple[int, ...], firm: bool, deadline_s: float, before: bytes = b""
    ) -> Steps[dict[int, Outcome]]:
        """The state of each, or what kind of fault there was.

        ``firm`` ones answered the last time. ``before``, a packet that nobody answers, goes out in one
        piece with the question.
        """
        begin_s = max(self._clock.now(), self._busy_until_s)
        size = self._free_size(servo_ids, begin_s)
        sent = before + self.question(servo_ids, size)
        if not self.clean:
            self._port.discard_input()
        self.clean = False
        self._port.write(sent)
        yield
        hearing = Hearing(servo_ids, size, wire.ReplyDecoder(size, self._owed.sizes() - {size}))
        self._listen(hearing, sent, begin_s + len(sent) * self.byte_s, firm, deadline_s)
        return self._judge(hearing)

    def _listen(self, hearing: Hearing, sent: bytes, sent_s: float, firm: bool, deadline_s: float) -> None:
        """The whole answer if it comes in time, or else piece by piece until the line falls silent."""
        expected = hearing.frame_size * len(hearing.servo_ids)
        due_s = sent_s + expected * self.byte_s
        wait_s = self.patience.wait_s(firm)
        data = self._port.read(expected + self._echo.expected(sent), min(due_s + wait_s, deadline_s))
        if self._echo.present is not False:
            data = self._echo.strip(sent, data)
        hearing.feed(data)
        end_s = min(self._clock.now() + FIRST_REPLY_S, deadline_s)  # however much noise there is
        while data and (lacking := hearing.lacking):
            gap_s = min(wait_s, RETRY_GAP_S) if hearing.replies else wait_s
            data = self._port.read(lacking, min(self._clock.now() + lacking * self.byte_s + gap_s, end_s))
            hearing.feed(data)
        hearing.finish()
        if not hearing.lacking:
            self.patience.heard(max(0.0, self._clock.now() - due_s))
        elif not hearing.answered:
            self.patience.in_vain()

    def _judge(self, hearing: Hearing) -> dict[int, Outcome]:
        """A value or a fault for everyone who was asked, each counted once."""
        outcome: dict[int, Outcome] = {}
        belated: set[int] = set()
        for reply in hearing.replies:
            if hearing.wanted(reply):
                self._counters.strange += reply.servo_id in outcome
                outcome[reply.servo_id] = self._state_of[reply.servo_id](reply.status, reply.data)
            elif counted := self._owed.settle(reply.servo_id, len(reply.data)):
                belated.add(reply.servo_id)
                self._was_late(reply.servo_id, counted)
            else:
                self._counters.strange += 1
        corrupt, noise = hearing.spoiled()
        self._counters.noise += noise
        self.clean = len(outcome) == len(hearing.replies) == len(hearing.servo_ids) and not noise
        if self.clean and self._echo.present is None:
            self._echo.present = False
        for servo_id in hearing.servo_ids:
            if servo_id not in outcome:
                outcome[servo_id] = "corrupt" if servo_id in corrupt else "late" if servo_id in belated else "silent"
        self._count(outcome, hearing.size)
        return outcome

    def _free_size(self, servo_ids: tuple[int, ...], now_s: float) -> int:
        self._owed.forget(now_s)
        return self._sizes[self._owed.free(dict.fromkeys(servo_ids, self._sizes))]

    def _was_late(self, servo_id: int, counted: Missed) -> None:
        """What was taken for silence, or for the garbage that came, was a late reply."""
        self._counters.of(servo_id).came_late(counted)
        self.patience.heard_late()

    def _count(self, outcome: Mapping[int, Outcome], size: int) -> None:
        now_s = self._clock.now()
        for servo_id, what in outcome.items():
            account = self._counters.of(servo_id)
            if isinstance(what, ServoState):
                account.replies += 1
                account.alarms += bool(what.alarms)
            elif what == "corrupt":
                # It may be another's garbage, and its own reply still to come.
                account.corrupt += 1
                self._owed.owe(servo_id, size, now_s, "corrupt")
            else:
                account.silent += 1
                self._owed.owe(servo_id, size, now_s, "silent")

    def has_time(self, servo_ids: tuple[int, ...], deadline_s: float, gap_s: float = 0.0) -> bool:
        """Whether they can be asked and answer before the deadline."""
        return self._clock.now() + self._on_wire_s(servo_ids) + gap_s < deadline_s

    def leaving_time_for(
        self, others: Sequence[tuple[int, ...]], servo_ids: tuple[int, ...], deadline_s: float
    ) -> float:
        """Until when to wait for ``servo_ids``, so that a silent one does not take the others' time."""
        needed_s = sum(self._on_wire_s(group) + FIRM_S for group in others)
        at_least_s = self._clock.now() + self._on_wire_s(servo_ids) + SPARE_S
        return min(max(deadline_s - needed_s, at_least_s), deadline_s)

    def _on_wire_s(self, servo_ids: tuple[int, ...]) -> float:
        """The time of a question and its answers, at most."""
        frame_size = self._largest + wire.OVERHEAD
        return (len(self.question(servo_ids, 1)) + frame_size * len(servo_ids)) * self.byte_s
