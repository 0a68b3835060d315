"""How well servos are heard at their bus's rate: every one is asked many times, and nobody hides another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from commissioning.doctor.snapshot import Heard
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.bus.types import FaultKind, Reading, ServoFault, ServoState
from drivers.clock import Clock
from drivers.errors import ServoError, ServoSilent

SAMPLES: Final = 10
"""Of each servo's state, over so much time that a supply's wobble shows."""
SAMPLE_S: Final = 0.02
MORE_TRIES: Final = 12
"""Where none of those gave a state: together about as long as a reply may be held back."""
STEADY_SHARE: Final = 0.6
"""Of the samples; a line that loses 9 % each way loses one in six of them."""


@dataclass(slots=True)
class Hearing:
    """What became of the questions to one servo."""

    states: list[ServoState] = field(default_factory=list)
    kinds: list[FaultKind | None] = field(default_factory=list)
    late: int = 0
    pings: bool = False

    def add(self, reading: Reading) -> None:
        """One more answer, or none."""
        if isinstance(reading, ServoFault):
            self.kinds.append(reading.kind)
        else:
            self.states.append(reading)
            self.kinds.append(None)

    @property
    def heard(self) -> Heard:
        """Two servos with one ID answer at the same moment, and what arrives is a mixture: every time."""
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
    """Ask all of them. Raises PortLost once the line is gone."""
    found = {i: Hearing() for i in servo_ids}
    late_before = {i: bus.counters.of(i).late for i in servo_ids}
    for _ in range(SAMPLES):
        _sample(bus, servo_ids, found)
        clock.sleep_until(clock.now() + SAMPLE_S)
    unclear = [i for i, hearing in found.items() if set(hearing.kinds) <= {"silent", "late"}]
    for _ in range(MORE_TRIES if unclear else 0):
        _sample(bus, unclear, found)
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
        pass  # somebody is there
    return True
