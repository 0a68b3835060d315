"""Bench for virtual servos that are read one after the other: AX, MX and SCS."""

from collections.abc import Sequence
from typing import Any

from drivers.bus.bus import Bus
from drivers.servos.register import ServoModel
from drivers.types import ServoState
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant


class ReadEachBench:
    """Servos of one model on a plant, with their bus."""

    def __init__(self, model: ServoModel, ids: Sequence[int], plant: BenchPlant) -> None:
        self.clock, self.plant, self.ids = SimulatedClock(10.0), plant, tuple(ids)
        self.servos: ServoLine[Any] = VirtualBus.of(plant, model)
        self.bus = Bus(VirtualPort(self.servos, self.clock), self.clock, dict.fromkeys(ids, model))

    def run(self, seconds: float) -> ServoState:
        """Wait, and return the state of the first servo."""
        self.clock.sleep_until(self.clock.now() + seconds)
        reading = self.bus.read_states(self.ids)[1]
        assert isinstance(reading, ServoState)
        return reading

    def ask(self, packet: bytes) -> bytes:
        """Send a packet, and return the replies of the next 10 ms."""
        now_s = self.clock.now()
        self.clock.sleep_until(now_s + 0.01)
        return b"".join(reply.data for reply in self.servos.receive(packet, now_s))
