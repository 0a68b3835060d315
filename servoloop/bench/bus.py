"""``servoloop bench bus``: measure the speed and error rate of a servo bus with the driver itself."""

import gc
import json
import logging
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Final

from rich.console import Console
from rich.table import Table

from drivers.bus.bus import Bus
from drivers.bus.late_replies import HELD_S
from drivers.clock import Clock, MonotonicClock
from drivers.driver_errors import DriverError
from drivers.port.serial_port import SerialPort
from drivers.servos.catalog import MODELS, model_advice
from drivers.servos.register import ServoModel
from drivers.types import Reading, ServoGoal, ServoState
from servoloop.bench.goals import answering_servos, present_goals, silent_servos
from servoloop.stack.processes import on_one_processor

LOG = logging.getLogger("servoloop")

BUDGET_S: Final = 0.04
"""Time limit of a cycle per servo, in seconds, including retries. Twice the time on the wire is added to this limit.

The limit allows for an adapter with a 16 ms latency timer, even if servos are read one by one. As a result, a slow
adapter is measured as slow instead of silent.
"""
LARGEST_ID: Final = 253


@dataclass(frozen=True, slots=True)
class BusSpeed:
    """Results of one measurement. A cycle lasts from one reply by at least one servo to the next such reply."""

    hz: float
    p50_us: float
    p99_us: float
    max_us: float
    cpu_us: float
    """Mean processor time of an exchange, in microseconds, including exchanges without a reply."""
    wire_us: float
    """Time that the bytes of a complete cycle take on the wire, in microseconds."""
    ratio: float
    """Ratio of ``p50_us`` to ``wire_us``."""
    faults: dict[str, int]
    """Number of faults of each type.

    ``silent`` counts each cycle without a reply from a servo, even if the servo was not read.
    """
    silent_servos: tuple[int, ...] = ()
    """IDs of the servos that do not respond after the measurement."""


@dataclass(frozen=True, slots=True)
class BusRun:
    """Data of one measurement. A cycle lasts from one answer by at least one servo to the next such answer."""

    took_s: list[float]
    """Duration of each cycle, in seconds."""
    all_s: float
    """Duration of the measurement, in seconds."""
    since_answer_s: float
    """Time since the last reply, in seconds."""
    cpu_s: float
    """Mean processor time of an exchange, in seconds."""
    on_wire_s: float
    """Time that the bytes of a complete cycle take on the wire, in seconds."""
    faults: dict[str, int]
    """Number of faults of each kind."""

    @property
    def figures(self) -> BusSpeed:
        """Results of this measurement."""
        times_s = sorted(self.took_s) or [self.all_s]
        count = len(times_s)
        p50_s, p99_s = times_s[count // 2], times_s[min(count - 1, count * 99 // 100)]
        return BusSpeed(
            hz=round(len(self.took_s) / self.all_s, 2),
            p50_us=round(p50_s * 1e6, 1),
            p99_us=round(p99_s * 1e6, 1),
            max_us=round(max(times_s[-1], self.since_answer_s) * 1e6, 1),
            cpu_us=round(self.cpu_s * 1e6, 1),
            wire_us=round(self.on_wire_s * 1e6, 1),
            ratio=round(p50_s / self.on_wire_s, 4),
            # A very late reply can reduce the number of silent faults counted before the measurement.
            faults={kind: max(0, number) for kind, number in self.faults.items()},
        )


def parse_ids(text: str) -> list[int]:
    """Parse servo IDs such as ``1-7`` or ``1,2,5-6``. Raises DriverError if the string is invalid."""
    found: list[int] = []
    try:
        for part in text.split(","):
            first, dash, last = part.partition("-")
            begin, end = int(first), int(last if dash else first)
            if not 0 <= begin <= end <= LARGEST_ID:
                raise ValueError
            found += range(begin, end + 1)
    except ValueError:
        raise DriverError(f"--ids must be IDs from 0 to {LARGEST_ID}, such as 1-7 or 1,2,5, not {text!r}") from None
    if len(set(found)) < len(found):
        raise DriverError(f"--ids must list each ID only once, not {text!r}")
    return found


def bench_bus(
    port: str, servo_ids: Sequence[int], model: str, baud: int, cycles: int, *, hold: bool = False
) -> BusSpeed:
    """Measure a bus.

    Args:
        port: Serial device of the bus.
        servo_ids: IDs of the servos.
        model: Name of the servo model.
        baud: Baud rate, in bits per second.
        cycles: Number of cycles to measure.
        hold: Whether to enable the torque of all servos during the measurement. If False, servos whose torque is
            off are only read.

    Returns:
        The results of the measurement.

    Raises:
        DriverError: No servo responds, the control table of every servo differs from that of ``model``, or the torque
            of a servo may still be on at the end.
    """
    if model not in MODELS:
        raise DriverError(f"unknown servo model {model}: {model_advice(model)}")
    clock = MonotonicClock()
    models = dict.fromkeys(servo_ids, MODELS[model])
    bus = Bus(SerialPort(port, baud, clock), clock, models)
    try:
        with standing_still(bus, servo_ids, MODELS[model], hold=hold) as goals, on_one_processor():
            figures = measure(bus, clock, servo_ids, goals, cycles)
            return replace(figures, silent_servos=silent_servos(bus, servo_ids))
    except ValueError as error:  # The goals of all servos do not fit in one packet; no goal was sent.
        raise DriverError(f"{bus.name}: {error}") from error
    finally:
        bus.close()


@contextmanager
def standing_still(
    bus: Bus, servo_ids: Sequence[int], model: ServoModel, *, hold: bool
) -> Iterator[dict[int, ServoGoal]]:
    """Yield goals that can be sent repeatedly without causing motion.

    At the end, the torque of each servo is restored to its initial state. If the torque of a servo may still be on,
    DriverError is raised, or a note is added to the exception that ended the block.
    """
    found = present_goals(bus, servo_ids, model)
    limp = sorted(found.limp)
    if limp and not hold:
        LOG.warning(
            "%s: the torque of servos %s is off, and a goal would enable it. These servos are only read, so a cycle "
            "transfers fewer bytes. With --hold, they hold their positions, and their torque is disabled at the end",
            bus.name, ", ".join(map(str, limp)),
        )  # fmt: skip
    goals = found.held | (found.limp if hold else {})
    try:
        if goals:
            bus.write_goals(goals)
        bus.read_states(servo_ids)  # During this read, the bus detects whether Dynamixel servos support fast reads.
        yield goals
    except BaseException as error:
        if held := _torque_left(bus, limp if hold else ()):
            error.add_note(held)
        raise
    if held := _torque_left(bus, limp if hold else ()):
        raise DriverError(held)


def _torque_left(bus: Bus, servo_ids: Sequence[int]) -> str:
    """Disable the torque of servos. Return a warning if the torque of a servo may still be on; otherwise, return an
    empty string."""
    try:
        errors: Sequence[DriverError] = bus.torque_off(servo_ids)
    except DriverError as error:  # the port is lost
        errors = [error]
    return f"{bus.name}: torque may still be on: {'; '.join(map(str, errors))}" if errors else ""


def wire_s(bus: Bus, servo_ids: Sequence[int], goals: Mapping[int, ServoGoal]) -> float:
    """Return the time that the bytes of one cycle (goals, read request and replies) take on the wire, in seconds."""
    return bus.exchange_size(goals, servo_ids) * 10.0 / bus.baud


def measure(bus: Bus, clock: Clock, servo_ids: Sequence[int], goals: Mapping[int, ServoGoal], cycles: int) -> BusSpeed:
    """Measure a number of cycles and return the results. Raises DriverError if no servo responds."""
    return run_cycles(bus, clock, servo_ids, goals, cycles).figures


def run_cycles(bus: Bus, clock: Clock, servo_ids: Sequence[int], goals: Mapping[int, ServoGoal], cycles: int) -> BusRun:
    """Read all states and write all goals in consecutive cycles without a pause, and return the duration of each cycle.

    Raises DriverError if no servo responds during or after the cycles.
    """
    now, first = clock.now, servo_ids[0]
    on_wire_s = wire_s(bus, servo_ids, goals)
    budget_s = BUDGET_S * len(servo_ids) + 2.0 * on_wire_s
    if any(bus.counters.faults().values()):
        clock.sleep_until(now() + HELD_S)  # exclude late replies from before the measurement
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
        if readings[first].__class__ is ServoState or _any_answer(readings):
            took_s.append(now_s - answered_s)
            answered_s = now_s
        else:
            # Servos that do not respond are not read in every cycle. Without this pause, such cycles would take almost
            # no time.
            clock.sleep_until(last_s + on_wire_s)
            now_s = now()
        last_s = now_s
    cpu_s = time.process_time() - cpu_s
    gc.unfreeze()
    faults = Counter(bus.counters.faults())
    faults.subtract(before)
    faults["silent"] += faults.pop("skipped")
    if not took_s:
        answering_servos(bus, servo_ids)  # raises an error that explains why no servo responds
    return BusRun(took_s, last_s - begin_s, last_s - answered_s, cpu_s / cycles, on_wire_s, dict(faults))


def _any_answer(readings: Mapping[int, Reading]) -> bool:
    return any(isinstance(reading, ServoState) for reading in readings.values())


def as_json(figures: BusSpeed) -> str:
    """Return the results as JSON on one line."""
    return json.dumps(asdict(figures))


def print_table(figures: BusSpeed, console: Console) -> None:
    """Print the results as a table."""
    table = Table(title="servo bus", show_header=False)
    for name, value in asdict(figures).items():
        if isinstance(value, float):
            table.add_row(name, f"{value:g}")
    for kind, count in figures.faults.items():
        table.add_row(f"faults: {kind}", str(count))
    console.print(table)
