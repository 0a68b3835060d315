"""Measure the quality of a bus: error counts over a hundred cycles, round-trip times, and the replies of each servo."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from statistics import median
from types import ModuleType
from typing import Final

from commissioning.doctor.snapshot import Heard, LineFigures
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.driver_errors import ServoError, ServoSilent
from drivers.port import Port
from drivers.port.line import BITS_PER_BYTE
from drivers.protocol import v1
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from drivers.types import FaultKind, Reading, ServoFault, ServoState

CYCLES: Final = 100
CYCLE_S: Final = 0.05
"""Maximum duration of one cycle, in seconds."""
ROUND_TRIPS: Final = 20
RETURN_DELAY_UNIT_S: Final = 2e-6
"""Unit of the return delay register, which is the same in all series, in seconds."""
READ_BYTES: Final = {True: 8 + 7, False: 14 + 12}
"""Size of a one-byte read request plus its reply, in bytes, for protocol 1 (True) and protocol 2 (False)."""
ECHO_S: Final = 0.02
COUNTED: Final = ("replies", "silent", "corrupt", "late", "refused", "reset")
"""Possible outcomes of a request that allowed enough time for a reply."""


def line_figures(
    bus: Bus, models: Mapping[int, ServoModel], clock: Clock, delays: Sequence[int], echoes: bool
) -> LineFigures:
    """Measure a bus on which all servos respond. Raises PortLost.

    Args:
        bus: The bus.
        models: Model of each servo, keyed by ID.
        clock: Clock for all delays and timeouts.
        delays: Values of the servos' return delay registers.
        echoes: Whether the adapter echoes every request. The value is copied into the result.
    """
    before, noise = _counted(bus, models), bus.counters.noise + bus.counters.strange
    cycles_s: list[float] = []
    for _ in range(CYCLES if models else 0):
        begin_s = clock.now()
        bus.read_states(tuple(models), begin_s + CYCLE_S)
        cycles_s.append(clock.now() - begin_s)
    after = _counted(bus, models)
    ended = {kind: after[kind] - before[kind] for kind in COUNTED}
    times = _round_trips(bus, models, clock)
    protocol_1 = not models or series_of(next(iter(models.values()))).protocol.packets is v1
    return LineFigures(
        asked=sum(ended.values()),
        lost=ended["silent"],
        corrupt=ended["corrupt"],
        late=ended["late"],
        noise=bus.counters.noise + bus.counters.strange - noise,
        round_trip_s=median(times) if times else None,
        wire_s=READ_BYTES[protocol_1] * BITS_PER_BYTE / bus.baud,
        delay_s=max(delays, default=0) * RETURN_DELAY_UNIT_S,
        echoes=echoes,
        cycle_s=median(cycles_s) if cycles_s else None,
    )


def _counted(bus: Bus, servo_ids: Mapping[int, object]) -> dict[str, int]:
    accounts = [asdict(bus.counters.of(i)) for i in servo_ids]
    return {kind: sum(account[kind] for account in accounts) for kind in COUNTED}


def _round_trips(bus: Bus, models: Mapping[int, ServoModel], clock: Clock) -> list[float]:
    """Return the durations of single one-byte reads, from all servos in turn."""
    times: list[float] = []
    servos = list(models.items())
    for number in range(ROUND_TRIPS if servos else 0):
        servo_id, model = servos[number % len(servos)]
        start_s = clock.now()
        try:
            bus.read(servo_id, series_of(model).torque_enable)
        except ServoError:
            continue
        times.append(clock.now() - start_s)
    return times


def hears_itself(port: Port, clock: Clock, packets: ModuleType, servo_id: int) -> bool:
    """Return whether the adapter echoes every request."""
    ping: bytes = packets.packet(servo_id, packets.PING, b"")
    port.discard_input()
    port.write(ping)
    data = port.read(len(ping), clock.now() + len(ping) * BITS_PER_BYTE / port.baud + ECHO_S)
    rest = port.read(64, clock.now() + ECHO_S)  # The servo's reply.
    return ping in data + rest


SAMPLES: Final = 10
"""Number of states to read from each servo, enough to reveal an unstable supply."""
SAMPLE_S: Final = 0.02
MORE_TRIES: Final = 12
"""Number of additional reads if no state was received. Together, these reads last as long as the longest possible delay
of a reply."""
STEADY_SHARE: Final = 0.6
"""Minimum fraction of successful reads for a servo that responds reliably. A bus that loses 9 % of the packets in each
direction loses one read in six.
"""


@dataclass(slots=True)
class Hearing:
    """Outcomes of all reads from one servo."""

    states: list[ServoState] = field(default_factory=list)
    kinds: list[FaultKind | None] = field(default_factory=list)
    late: int = 0
    pings: bool = False
    alone: bool = False
    """Whether the servo responds to single reads but not to group reads."""

    def add(self, reading: Reading) -> None:
        """Add the outcome of one read."""
        if isinstance(reading, ServoFault):
            self.kinds.append(reading.kind)
        else:
            self.states.append(reading)
            self.kinds.append(None)

    @property
    def heard(self) -> Heard:
        """Quality of the replies.

        Two servos with the same ID reply at the same time. Each reply arrives as a mixture of both, so the quality is
        "broken".
        """
        good = self.kinds.count(None)
        if self.late > 1 + good and not {None, "corrupt"} & set(self.kinds[:SAMPLES]):
            return "late"
        if good:
            return "well" if good >= STEADY_SHARE * len(self.kinds) else "unsteady"
        if set(self.kinds) <= {"silent", "late"}:
            return "mute" if self.pings else "silent"
        if "refused" in self.kinds:
            return "mute"
        return "unsteady" if {"silent", "reset"} & set(self.kinds) else "broken"


def hear(bus: Bus, servo_ids: Sequence[int], clock: Clock) -> Mapping[int, Hearing]:
    """Read the states of all servos several times. Raises PortLost if the port disappears."""
    found = {i: Hearing() for i in servo_ids}
    late_before = {i: bus.counters.of(i).late for i in servo_ids}
    for _ in range(SAMPLES):
        _sample(bus, servo_ids, found)
        clock.sleep_until(clock.now() + SAMPLE_S)
    unclear = [i for i, hearing in found.items() if set(hearing.kinds) <= {"silent", "late"}]
    for _ in range(MORE_TRIES if unclear else 0):
        _sample(bus, unclear, found)
    alone = [i for i in unclear if not found[i].states and bus.needs_single_reads(i)]
    for i in alone:
        found[i] = Hearing(alone=True)
    for _ in range(SAMPLES if alone else 0):
        _sample(bus, alone, found)
        clock.sleep_until(clock.now() + SAMPLE_S)
    unclear = [i for i in unclear if i not in alone]
    for i, hearing in found.items():
        hearing.late = bus.counters.of(i).late - late_before[i]
        hearing.pings = i in unclear and _pings(bus, i)
    return found


def _sample(bus: Bus, servo_ids: Sequence[int], found: Mapping[int, Hearing]) -> None:
    for i, reading in bus.read_states(servo_ids).items():
        found[i].add(reading)


def _pings(bus: Bus, servo_id: int) -> bool:
    try:
        retry(partial(bus.ping, servo_id))
    except ServoSilent:
        return False
    except ServoError:
        pass  # Any other error shows that a servo has this ID.
    return True
