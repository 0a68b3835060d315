"""One cycle in the same order as in the control loop."""

from collections.abc import Mapping, Sequence

from drivers.bus.bus import Bus
from drivers.types import Reading, ServoGoal


def exchange(
    bus: Bus, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int], deadline_s: float
) -> Mapping[int, Reading]:
    """Read the states, then write the goals."""
    bus.request(servo_ids, deadline_s)
    readings = bus.receive()
    bus.write_goals(goals)
    return readings
