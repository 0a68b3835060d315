"""Count the cycles that other servos on a bus lose while one servo is silent, for each make and period.

The measurement runs in simulated time.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from drivers.bus.bus import Bus
from drivers.servos import sts, x
from drivers.servos.register import ServoModel
from drivers.types import ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant

MODELS: Final[dict[str, ServoModel]] = {"feetech": sts.STS3215, "dynamixel": x.XL430_W250}
PERIODS_S: Final = (0.012, 0.02, 0.05)
SILENT_S: Final = 0.2
SHARE: Final = 0.8
"""Fraction of the period within which the states must be read."""


class Cycles:
    """Bus that is read at a fixed period."""

    def __init__(self, make: str, ids: Sequence[int], period_s: float) -> None:
        self.ids, self.period_s, self.clock = tuple(ids), period_s, SimulatedClock()
        models = dict.fromkeys(self.ids, MODELS[make])
        plant = BenchPlant(self.ids, timestep_s=0.005)
        maker: Any = VirtualBus if make == "feetech" else VirtualDynamixelBus
        self.line: ServoLine[Any] = maker.of(plant, models)
        self.bus = Bus(VirtualPort(self.line, self.clock), self.clock, models)
        for servo_id, model in models.items():
            self.bus.identify(servo_id, model)
        self.bus.read_states(self.ids)

    def missing(self) -> set[int]:
        """Run one cycle. Return the servos whose state was not received."""
        next_s = self.clock.now() + self.period_s
        readings = self.bus.read_states(self.ids, self.clock.now() + SHARE * self.period_s)
        self.clock.sleep_until(next_s)
        return {i for i, reading in readings.items() if not isinstance(reading, ServoState)}


def lost_cycles(make: str, servos: int, period_s: float) -> dict[int, int]:
    """Make each servo in turn silent for 0.2 s.

    Returns:
        Maximum number of cycles that any other servo has lost, keyed by the ID of the silent servo.
    """
    lost: dict[int, int] = {}
    for silent in range(1, servos + 1):
        cycles = Cycles(make, range(1, servos + 1), period_s)
        cycles.missing()
        cycles.line.faults.silence(silent)
        counted = Counter(i for _ in range(round(SILENT_S / period_s)) for i in cycles.missing())
        cycles.line.faults.restore(silent)
        counted.update(i for _ in range(round(1.0 / period_s)) for i in cycles.missing())
        lost[silent] = max((count for i, count in counted.items() if i != silent), default=0)
    return lost


def show_silent(console: Console, servos: int) -> None:
    """Print one line for each make and period."""
    table = Table(
        "make",
        "period",
        "cycles lost by the other servos, for each silent servo",
        title=f"one servo silent for {SILENT_S} s",
    )
    for make in MODELS:
        for period_s in PERIODS_S:
            lost = lost_cycles(make, servos, period_s)
            table.add_row(make, f"{period_s * 1e3:g} ms", " ".join(map(str, lost.values())))
    console.print(table)
