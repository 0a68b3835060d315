"""``servoloop bench bus``: how fast and how clean a line of servos is, measured with the driver itself."""

import gc
import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from rich.console import Console
from rich.table import Table

from drivers.bus import Reading, ServoBus, ServoGoal, ServoState
from drivers.clock import Clock, MonotonicClock
from drivers.errors import DriverError
from drivers.makes import MODELS, bus_for
from drivers.serial_port import SerialPort
from servoloop.realtime import on_one_processor

BUDGET_S: Final = 0.01
"""What a cycle may spend on reading, retries included."""
FIRST_TRIES: Final = 3
LARGEST_ID: Final = 253


@dataclass(frozen=True, slots=True)
class Figures:
    """One run. Times in microseconds a cycle."""

    hz: float
    p50_us: float
    p99_us: float
    max_us: float
    cpu_us: float
    wire_us: float
    """The wire's own time for the bytes of a cycle without faults."""
    ratio: float
    """p50 to wire."""
    faults: dict[str, int]
    """By kind: ``silent`` counts every cycle in which a servo was missed, asked or not."""


def parse_ids(text: str) -> list[int]:
    """``1-7`` or ``1,2,5-6`` as a list. Raises DriverError where it is neither."""
    found: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.partition("-")
            found += range(int(first), int(last or first) + 1)
    except ValueError:
        raise DriverError(f"--ids takes something like 1-7 or 1,2,5, not {text!r}") from None
    if not found or len(set(found)) < len(found) or not all(0 <= i <= LARGEST_ID for i in found):
        raise DriverError(f"--ids takes different IDs from 0 to 253, not {text!r}")
    return found


def bench_bus(port: str, servo_ids: Sequence[int], model: str, baud: int, cycles: int) -> Figures:
    """Open the port, run and close it. Raises DriverError where nobody answers."""
    if model not in MODELS:
        raise DriverError(f"unknown model {model}: known are {', '.join(sorted(MODELS))}")
    clock = MonotonicClock()
    models = dict.fromkeys(servo_ids, MODELS[model])
    bus = bus_for(models, SerialPort(port, baud, clock), clock)
    try:
        goals = _stand_still(bus, servo_ids)
        with on_one_processor():
            return measure(bus, clock, servo_ids, goals, cycles, wire_s(bus, servo_ids, baud))
    finally:
        bus.close()


def wire_s(bus: ServoBus, servo_ids: Sequence[int], baud: int) -> float:
    """How long the bytes of one cycle take: the goals, the question, the answers."""
    return bus.exchange_size(servo_ids) * 10.0 / baud


def _stand_still(bus: ServoBus, servo_ids: Sequence[int]) -> dict[int, ServoGoal]:
    """Every servo's goal is where it stands: a measurement moves nothing."""
    goals: dict[int, ServoGoal] = {}
    for _ in range(FIRST_TRIES):
        readings = bus.read_states(servo_ids)
        goals |= {i: ServoGoal(r.position_counts) for i, r in readings.items() if isinstance(r, ServoState)}
        if len(goals) == len(servo_ids):
            return goals
    if not goals:
        raise DriverError(f"no servo answers on {bus.name}: check the servos' power, their IDs and the baud rate")
    return goals


def measure(
    bus: ServoBus, clock: Clock, servo_ids: Sequence[int], goals: dict[int, ServoGoal], cycles: int, on_wire_s: float
) -> Figures:
    """``cycles`` times goals out and states in, one after the other without a pause."""
    took_s: list[float] = []
    now, shortest_s = clock.now, 0.5 * on_wire_s
    before = Counter(bus.counters.faults())
    gc.collect()
    gc.freeze()
    cpu_s, begin_s = time.process_time(), clock.now()
    last_s = begin_s
    for _ in range(cycles):
        readings = bus.exchange(goals, servo_ids, last_s + BUDGET_S)
        if len(goals) < len(servo_ids):
            _add_goals(goals, readings)
        now_s = now()
        if now_s - last_s < shortest_s and not any(isinstance(r, ServoState) for r in readings.values()):
            # Nobody was asked, for all are known to be silent: such cycles must not race through the run.
            clock.sleep_until(last_s + on_wire_s)
            now_s = now()
        took_s.append(now_s - last_s)
        last_s = now_s
    cpu_s = time.process_time() - cpu_s
    gc.unfreeze()
    faults = Counter(bus.counters.faults())
    faults.subtract(before)
    faults["silent"] += faults.pop("skipped")
    return _figures(sorted(took_s), cpu_s, on_wire_s, dict(faults))


def _add_goals(goals: dict[int, ServoGoal], readings: Mapping[int, Reading]) -> None:
    for servo_id, reading in readings.items():
        if servo_id not in goals and isinstance(reading, ServoState):
            goals[servo_id] = ServoGoal(reading.position_counts)


def _figures(took_s: list[float], cpu_s: float, on_wire_s: float, faults: dict[str, int]) -> Figures:
    count = len(took_s)
    p50_s, p99_s = took_s[count // 2], took_s[min(count - 1, count * 99 // 100)]
    return Figures(
        hz=round(count / sum(took_s), 2),
        p50_us=round(p50_s * 1e6, 1),
        p99_us=round(p99_s * 1e6, 1),
        max_us=round(took_s[-1] * 1e6, 1),
        cpu_us=round(cpu_s / count * 1e6, 1),
        wire_us=round(on_wire_s * 1e6, 1),
        ratio=round(p50_s / on_wire_s, 4),
        faults=faults,
    )


def as_json(figures: Figures) -> str:
    """One line."""
    return json.dumps(asdict(figures))


def print_table(figures: Figures, console: Console) -> None:
    """For people."""
    table = Table(title="servo bus", show_header=False)
    for name, value in asdict(figures).items():
        if name != "faults":
            table.add_row(name, f"{value:g}")
    for kind, count in figures.faults.items():
        table.add_row(f"faults: {kind}", str(count))
    console.print(table)
