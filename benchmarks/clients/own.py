"""The project's own driver as a benchmark client."""

from collections.abc import Sequence

from benchmarks.clients.peers import Client
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.types import ServoFault, ServoGoal


def own_client(bus: Bus, clock: Clock, servo_ids: Sequence[int]) -> Client:
    """Return a client that reads and decodes the states, and then writes the goals, as the control loop does."""
    goals = {i: ServoGoal(2048) for i in servo_ids}

    def cycle() -> bool:
        bus.request(servo_ids, clock.now() + 0.05)
        readings = bus.receive()
        bus.write_goals(goals)
        return ServoFault not in set(map(type, readings.values()))

    return cycle, bus.close
