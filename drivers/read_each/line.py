"""One question and its answers on the line: asked, waited for, judged, counted."""

from collections.abc import Mapping, Sequence
from typing import Final

from drivers.burst import Burst
from drivers.bus import ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.echo import Echo
from drivers.feetech import wire
from drivers.hearing import Hearing
from drivers.owed import Missed
from drivers.port import Port
from drivers.read_each.patience import FIRM_S, FIRST_REPLY_S, SPARE_S, Patience
from drivers.read_each.series import Series, StateOf
from drivers.readings import Outcome, refused
from drivers.turns import Steps, Wait

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


class Line(Burst[wire.Reply]):
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
        super().__init__(port, clock, echo, counters)
        self._address = series.state_address
        self._state_of = state_of
        self._sizes = series.state_sizes
        self._refusals, self._alarms = series.refusals, series.alarms
        self._largest = max(series.state_sizes)
        self.patience = Patience()

    def question(self, servo_ids: tuple[int, ...], size: int) -> bytes:
        """A read for one servo, a bulk read for several."""
        if len(servo_ids) == 1:
            return read_packet(servo_ids[0], self._address, size)
        return bulk_packet(servo_ids, self._address, size)

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
        try:
            yield Wait.NEXT if firm else Wait.DOUBTFUL
        except GeneratorExit:
            self.give_up(dict.fromkeys(servo_ids, size))
            raise
        decoder = wire.ReplyDecoder(size, self._owed.sizes() - {size}, self._refusals)
        hearing = Hearing(dict.fromkeys(servo_ids, size), wire.OVERHEAD, decoder, self._doubted())
        self._listen(hearing, servo_ids, sent, begin_s + len(sent) * self.byte_s, firm, deadline_s)
        noise = self._counters.noise
        outcome = self._judge(hearing)
        whole = len(hearing.answered) == len(hearing.replies) == len(servo_ids)
        all_states = all(isinstance(what, ServoState) for what in outcome.values())
        self.clean = whole and all_states and self._counters.noise == noise
        if self.clean and self._echo.present is None:
            self._echo.present = False
        return outcome

    def _listen(
        self,
        hearing: Hearing[wire.Reply],
        servo_ids: tuple[int, ...],
        sent: bytes,
        sent_s: float,
        firm: bool,
        deadline_s: float,
    ) -> None:
        """The whole answer if it comes in time, or else piece by piece until the line falls silent."""
        expected = hearing.lacking(servo_ids)
        due_s = sent_s + expected * self.byte_s
        wait_s = self.patience.wait_s(firm)
        until_s = min(due_s + wait_s, deadline_s)
        waited_from_s = max(due_s, self._clock.now())  # another line may have been waited for until now
        data = self._port.read(expected + self._echo.expected(sent), until_s)
        if self._echo.present is not False:
            data = self._behind_echo(sent, data, expected, until_s)
        hearing.feed(data)
        end_s = min(self._clock.now() + FIRST_REPLY_S, deadline_s)  # however much noise there is
        while data and (lacking := hearing.lacking(servo_ids)):
            gap_s = min(wait_s, RETRY_GAP_S) if hearing.replies else wait_s
            data = self._port.read(lacking, min(self._clock.now() + lacking * self.byte_s + gap_s, end_s))
            hearing.feed(data)
        hearing.finish()
        if not hearing.lacking(servo_ids):
            self.patience.heard(max(0.0, self._clock.now() - waited_from_s))
        elif not hearing.answered:
            self.patience.in_vain()

    def _said(self, reply: wire.Reply) -> Outcome | None:
        """Nothing where the servo's model is not known."""
        if complaints := reply.error & self._refusals:
            return refused(reply.servo_id, f"it names a {' and '.join(self._alarms(complaints))} error")
        state_of = self._state_of.get(reply.servo_id)
        return state_of(reply.error, reply.data) if state_of else None

    def _count(
        self, outcome: Mapping[int, Outcome], sizes: Mapping[int, int], belated: Sequence[tuple[int, Missed]]
    ) -> None:
        super()._count(outcome, sizes, belated)
        if belated:
            self.patience.heard_late()

    def _free_size(self, servo_ids: tuple[int, ...], now_s: float) -> int:
        self._owed.forget(now_s)
        return self._sizes[self._owed.free(dict.fromkeys(servo_ids, self._sizes))]

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
