"""What bursts of replies have in common, whatever the packets: sending, waiting, counting."""

from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Final, Protocol, TypeVar

from drivers.bus import FaultKind, ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters, ServoCounters
from drivers.echo import Echo
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

AnyReply = TypeVar("AnyReply")
_ALARMS_OF: Final = attrgetter("alarms")


class Decoder(Protocol[AnyReply]):
    """Bytes in any pieces to replies."""

    def feed(self, data: bytes) -> list[AnyReply]: ...


class Hearing(Protocol[AnyReply]):
    """What has come of one burst that did not come as a whole."""

    @property
    def decoder(self) -> Decoder[AnyReply]: ...

    def take(self, replies: Sequence[AnyReply]) -> None: ...

    def lacking(self, servo_ids: tuple[int, ...]) -> int: ...


class Burst:
    """One port's bursts. Counts what goes wrong; raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, echo: Echo, counters: BusCounters) -> None:
        self._port = port
        self._clock = clock
        self._echo = echo
        self._counters = counters
        self._owed = OwedReplies()
        self._accounts: dict[tuple[int, ...], list[ServoCounters]] = {}
        self._byte_s = BITS_PER_BYTE / port.baud
        self._busy_until_s = 0.0
        self._sent, self._sent_s = b"", 0.0
        self.clean = False
        """Whether the last answer was whole, so that nothing can be left to throw away."""

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

    def _all_well(self, servo_ids: tuple[int, ...], states: Mapping[int, ServoState]) -> Mapping[int, ServoState]:
        if self._echo.present is None:
            self._echo.present = False
        accounts = self._accounts.get(servo_ids)
        if accounts is None:
            accounts = self._accounts[servo_ids] = [self._counters.of(i) for i in servo_ids]
        for account in accounts:
            account.replies += 1
        if any(map(_ALARMS_OF, states.values())):
            for servo_id, reading in states.items():
                self._counters.of(servo_id).alarms += bool(reading.alarms)
        return states

    def _wait_for(
        self, hearing: Hearing[AnyReply], servo_ids: tuple[int, ...], gap_s: float, deadline_s: float
    ) -> None:
        end_s = min(self._clock.now() + FIRST_REPLY_S + gap_s * len(servo_ids), deadline_s)  # however much noise
        while lacking := hearing.lacking(servo_ids):
            patience_s = self._clock.now() + lacking * self._byte_s + gap_s
            data = self._port.read(lacking, min(patience_s, end_s))
            if not data:
                return
            hearing.take(hearing.decoder.feed(data))

    def _missed(
        self, servo_ids: Sequence[int], outcome: dict[int, Outcome], corrupt: set[int], belated: Mapping[int, Missed]
    ) -> None:
        """Whoever has given no state: why."""
        for servo_id in servo_ids:
            if servo_id not in outcome:
                kind: FaultKind = "late" if servo_id in belated else "silent"
                outcome[servo_id] = "corrupt" if servo_id in corrupt else kind

    def _count(self, outcome: Mapping[int, Outcome], sizes: Mapping[int, int], belated: Mapping[int, Missed]) -> None:
        """Each question once. ``sizes``: the bytes that each was asked for."""
        now_s = self._clock.now()
        for servo_id, what in outcome.items():
            account = self._counters.of(servo_id)
            if isinstance(what, ServoState):
                account.replies += 1
                account.alarms += bool(what.alarms)
            else:
                account.corrupt += what == "corrupt"
                account.silent += what != "corrupt"
                self._owed.owe(servo_id, sizes[servo_id], now_s, "corrupt" if what == "corrupt" else "silent")
        for servo_id, counted in belated.items():
            self._counters.of(servo_id).came_late(counted)
