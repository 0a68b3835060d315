"""``servoloop bench bus``: how fast and how clean a line of servos is, measured with the driver itself."""

import gc
import json
import logging
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Final

from rich.console import Console
from rich.table import Table

from drivers.bus.bus import Bus
from drivers.bus.late_replies import HELD_S
from drivers.bus.types import Reading, ServoGoal, ServoState
from drivers.clock import Clock, MonotonicClock
from drivers.errors import DriverError
from drivers.port.serial_port import SerialPort
from drivers.servos.catalog import MODELS
from drivers.servos.register import ServoModel
from servoloop.bench.goals import present_goals, who_answers
from servoloop.stack.processes import on_one_processor

LOG = logging.getLogger("servoloop")

BUDGET_S: Final = 0.04
"""What a cycle may spend for each servo beside twice its bytes' time on the wire, retries included. An adapter's
latency timer of 16 ms must fit, and some servos are asked one by one: a slow adapter must be seen as one."""
LARGEST_ID: Final = 253


@dataclass(frozen=True, slots=True)
class Figures:
    """One run. A cycle goes from one answer of at least one servo to the next. Times in microseconds."""

    hz: float
    p50_us: float
    p99_us: float
    max_us: float
    cpu_us: float
    """Of processor time, over all exchanges, also those in which nobody answered."""
    wire_us: float
    """The wire's own time for the bytes of a cycle in which each servo answers."""
    ratio: float
    """p50 to wire."""
    faults: dict[str, int]
    """By kind: ``silent`` counts every cycle in which a servo was missed, asked or not."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run as it was measured, s. A cycle goes from one answer of at least one servo to the next."""

    took_s: list[float]
    """Each such cycle."""
    all_s: float
    since_answer_s: float
    """What came behind the last answer."""
    cpu_s: float
    """Of processor time in an exchange."""
    on_wire_s: float
    faults: dict[str, int]

    @property
    def figures(self) -> Figures:
        """In short."""
        times_s = sorted(self.took_s) or [self.all_s]
        count = len(times_s)
        p50_s, p99_s = times_s[count // 2], times_s[min(count - 1, count * 99 // 100)]
        return Figures(
            hz=round(len(self.took_s) / self.all_s, 2),
            p50_us=round(p50_s * 1e6, 1),
            p99_us=round(p99_s * 1e6, 1),
            max_us=round(max(times_s[-1], self.since_answer_s) * 1e6, 1),
            cpu_us=round(self.cpu_s * 1e6, 1),
            wire_us=round(self.on_wire_s * 1e6, 1),
            ratio=round(p50_s / self.on_wire_s, 4),
            # A reply that came even later than was waited for takes back a silence of before the run.
            faults={kind: max(0, number) for kind, number in self.faults.items()},
        )


def parse_ids(text: str) -> list[int]:
    """``1-7`` or ``1,2,5-6`` as a list. Raises DriverError where it is neither."""
    found: list[int] = []
    try:
        for part in text.split(","):
            first, dash, last = part.partition("-")
            begin, end = int(first), int(last if dash else first)
            if not 0 <= begin <= end <= LARGEST_ID:
                raise ValueError
            found += range(begin, end + 1)
    except ValueError:
        raise DriverError(f"--ids takes IDs from 0 to {LARGEST_ID}, such as 1-7 or 1,2,5, not {text!r}") from None
    if len(set(found)) < len(found):
        raise DriverError(f"--ids takes different IDs, not {text!r}")
    return found


def bench_bus(
    port: str, servo_ids: Sequence[int], model: str, baud: int, cycles: int, *, hold: bool = False
) -> Figures:
    """Open the port, run and close it. Limp servos are only read, unless ``hold`` switches them on for the run.

    Raises DriverError where nobody answers, or only servos with another table than ``model``.
    """
    if model not in MODELS:
        raise DriverError(f"unknown model {model}: known are {', '.join(sorted(MODELS))}")
    clock = MonotonicClock()
    models = dict.fromkeys(servo_ids, MODELS[model])
    bus = Bus(SerialPort(port, baud, clock), clock, models)
    try:
        with standing_still(bus, servo_ids, MODELS[model], hold=hold) as goals, on_one_processor():
            return measure(bus, clock, servo_ids, goals, cycles)
    except ValueError as error:  # of the bus, before any goal goes out: more servos than a packet holds
        raise DriverError(f"{bus.name}: {error}") from error
    finally:
        bus.close()


@contextmanager
def standing_still(
    bus: Bus, servo_ids: Sequence[int], model: ServoModel, *, hold: bool
) -> Iterator[dict[int, ServoGoal]]:
    """Give the goals that servos may be told again and again; behind it all have the torque that they had before."""
    found = present_goals(bus, servo_ids, model)
    limp = sorted(found.limp)
    if limp and not hold:
        LOG.warning(
            "%s: servos %s have no torque, and a goal would switch it on: they are only read, and a cycle has fewer "
            "bytes. --hold holds them where they stand, and lets go of them in the end",
            bus.name, ", ".join(map(str, limp)),
        )  # fmt: skip
    goals = found.held | (found.limp if hold else {})
    try:
        if goals:
            bus.write_goals(goals)
        bus.read_states(servo_ids)  # a Dynamixel's map is new: this finds out whether they can be read fast
        yield goals
    finally:
        for error in bus.torque_off(limp) if hold else ():
            LOG.error("%s: %s. Its torque may still be on", bus.name, error)


def wire_s(bus: Bus, servo_ids: Sequence[int], goals: Mapping[int, ServoGoal]) -> float:
    """How long the bytes of one cycle take: the goals, the question, the answers."""
    return bus.exchange_size(goals, servo_ids) * 10.0 / bus.baud


def measure(bus: Bus, clock: Clock, servo_ids: Sequence[int], goals: Mapping[int, ServoGoal], cycles: int) -> Figures:
    """``cycles`` times goals out and states in, one after the other without a pause.

    Raises DriverError where nobody answers in any of them, nor behind them.
    """
    return run_cycles(bus, clock, servo_ids, goals, cycles).figures


def run_cycles(bus: Bus, clock: Clock, servo_ids: Sequence[int], goals: Mapping[int, ServoGoal], cycles: int) -> Run:
    """The same, with the time of every cycle."""
    now, first = clock.now, servo_ids[0]
    on_wire_s = wire_s(bus, servo_ids, goals)
    budget_s = BUDGET_S * len(servo_ids) + 2.0 * on_wire_s
    if any(bus.counters.faults().values()):
        clock.sleep_until(now() + HELD_S)  # what comes late from before the run is none of its
        bus.read_states(servo_ids)
    before = Counter(bus.counters.faults())
    took_s: list[float] = []
    gc.collect()
    gc.freeze()
    cpu_s = time.process_time()
    begin_s = answered_s = last_s = now()
    for _ in range(cycles):
        bus.request(servo_ids, last_s + budget_s)
        readings = bus.receive()
        bus.write_goals(goals)
        now_s = now()
        if readings[first].__class__ is ServoState or _anybody(readings):
            took_s.append(now_s - answered_s)
            answered_s = now_s
        else:
            # Whoever is known to be silent is not asked in every cycle: such cycles must not race through the run.
            clock.sleep_until(last_s + on_wire_s)
            now_s = now()
        last_s = now_s
    cpu_s = time.process_time() - cpu_s
    gc.unfreeze()
    faults = Counter(bus.counters.faults())
    faults.subtract(before)
    faults["silent"] += faults.pop("skipped")
    if not took_s:
        who_answers(bus, servo_ids)
    return Run(took_s, last_s - begin_s, last_s - answered_s, cpu_s / cycles, on_wire_s, dict(faults))


def _anybody(readings: Mapping[int, Reading]) -> bool:
    return any(isinstance(reading, ServoState) for reading in readings.values())


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
