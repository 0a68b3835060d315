"""What ``servoloop bench bus`` makes of a line that is interrupted, on simulated time."""

from drivers.bus import ServoGoal
from drivers.feetech.bus import FeetechBus
from servoloop.bench_bus import measure, wire_s
from sim_backend.bus import VirtualBus
from sim_backend.clock import SimulatedClock
from sim_backend.plant import BenchPlant
from sim_backend.port import VirtualPort

IDS = (1, 2, 3, 4, 5, 6, 7)
BAUD = 1_000_000


class Interrupted(VirtualPort):
    """Nobody hears anything between two times."""

    from_s = 0.5
    to_s = 0.55

    def write(self, data: bytes) -> None:
        if not self.from_s <= self._clock.now() < self.to_s:
            super().write(data)


def test_an_interruption_costs_as_many_cycles_as_it_lasts() -> None:
    """Whoever is known to be silent is not asked: cycles in which nobody is asked must not race through the run."""
    clock = SimulatedClock(0.0)
    bus = FeetechBus(Interrupted(VirtualBus.of(BenchPlant(IDS)), clock), clock)
    goals = {i: ServoGoal(2048) for i in IDS}
    figures = measure(bus, clock, IDS, goals, 1000, wire_s(bus, IDS, BAUD))
    assert 0 < figures.faults["silent"] < 7 * 60
    assert 1.0 <= figures.ratio < 1.2
