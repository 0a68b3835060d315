"""``servoloop bench bus``: how fast and how clean a line of servos is, measured with the driver itself."""

import gc
import json
import logging
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from rich.console import Console
from rich.table import Table

from drivers.bus import Reading, ServoBus, ServoGoal, ServoState
from drivers.clock import Clock, MonotonicClock
from drivers.errors import DriverError, ServoCorrupt, ServoError, ServoRefused, ServoSilent
from drivers.makes import MODELS, bus_for, model_numbers
from drivers.registers import ServoModel
from drivers.serial_port import SerialPort
from servoloop.realtime import on_one_processor

LOG = logging.getLogger("servoloop")

BUDGET_S: Final = 0.04
"""What a cycle may spend for each servo beside twice its bytes' time on the wire, retries included. An adapter's
latency timer of 16 ms must fit, and some servos are asked one by one: a slow adapter must be seen as one."""
TRIES: Final = 3
LARGEST_ID: Final = 253
KNOWN: Final = frozenset(model.number for model in MODELS.values())


@dataclass(frozen=True, slots=True)
class Figures:
    """One run. Times in microseconds a cycle, of those cycles in which at least one servo answered."""

    hz: float
    p50_us: float
    p99_us: float
    max_us: float
    cpu_us: float
    """Over all cycles."""
    wire_us: float
    """The wire's own time for the bytes of a cycle in which each servo answers and gets a goal."""
    ratio: float
    """p50 to wire."""
    faults: dict[str, int]
    """By kind: ``silent`` counts every cycle in which a servo was missed, asked or not."""


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


def bench_bus(port: str, servo_ids: Sequence[int], model: str, baud: int, cycles: int) -> Figures:
    """Open the port, run and close it. Raises DriverError where nobody answers, or another model than ``model``."""
    if model not in MODELS:
        raise DriverError(f"unknown model {model}: known are {', '.join(sorted(MODELS))}")
    clock = MonotonicClock()
    models = dict.fromkeys(servo_ids, MODELS[model])
    bus = bus_for(models, SerialPort(port, baud, clock), clock)
    try:
        goals = stand_still(bus, servo_ids, MODELS[model])
        with on_one_processor():
            return measure(bus, clock, servo_ids, goals, cycles, wire_s(bus, servo_ids, baud))
    except ValueError as error:  # of the bus, before anything goes out: more servos than a packet holds
        raise DriverError(f"{bus.name}: {error}") from error
    finally:
        bus.close()


def wire_s(bus: ServoBus, servo_ids: Sequence[int], baud: int) -> float:
    """How long the bytes of one cycle take: the goals, the question, the answers."""
    return bus.exchange_size(servo_ids) * 10.0 / baud


def stand_still(bus: ServoBus, servo_ids: Sequence[int], model: ServoModel) -> dict[int, ServoGoal]:
    """Give each servo the goal that it has already, and return these goals: a measurement moves nothing.

    Raises ServoRefused, before any goal goes out, where a servo is not of this model: what is a goal to one may be a
    setting to another. One that is in another mode, answers that question in pieces or answers only later is read and
    gets no goal.
    """
    states = _states(bus, servo_ids)
    goals = {i: goal for i, state in states.items() if (goal := _goal(bus, i, model, state))}
    bus.write_goals(goals)
    bus.read_states(servo_ids)  # a Dynamixel's map is new: this finds out whether they can be read fast
    return goals


def _states(bus: ServoBus, servo_ids: Sequence[int]) -> dict[int, ServoState]:
    """Of all who answer."""
    states: dict[int, ServoState] = {}
    for _ in range(TRIES):
        states |= {i: r for i, r in bus.read_states(servo_ids).items() if isinstance(r, ServoState)}
        if len(states) == len(servo_ids):
            return states
    if not states:
        raise DriverError(f"no servo answers on {bus.name}: check the servos' power, their IDs and the baud rate")
    return states


def _goal(bus: ServoBus, servo_id: int, model: ServoModel, state: ServoState) -> ServoGoal | None:
    """None for one that must not have any.

    Of a simulator that answers group reads and no others the user's word is taken: no servo does so.
    """
    failure: ServoError | None = None
    for _ in range(TRIES):
        try:
            if not _is_fit(bus, servo_id, model):
                return None
            # Under a load it stands beside its goal: to make that the goal would lower the load, run by run.
            return ServoGoal(bus.goal(servo_id) if bus.torque_is_on(servo_id) else state.position_counts)
        except (ServoSilent, ServoCorrupt) as error:
            failure = error
    return ServoGoal(state.position_counts) if isinstance(failure, ServoSilent) else None


def _is_fit(bus: ServoBus, servo_id: int, model: ServoModel) -> bool:
    """Whether it may have goals. A simulator without a table says 0 for its model: there too the user is believed."""
    try:
        bus.identify(servo_id, model)
    except ServoRefused as error:
        number, elsewhere = (bus.read(servo_id, register) for register in model_numbers(model))
        if number not in (0, model.number) or (number == 0 and elsewhere in KNOWN):
            raise
        if number:
            LOG.warning("%s. It is read and gets no goal", error)
        return number == 0
    return True


def measure(
    bus: ServoBus, clock: Clock, servo_ids: Sequence[int], goals: Mapping[int, ServoGoal], cycles: int, on_wire_s: float
) -> Figures:
    """``cycles`` times goals out and states in, one after the other without a pause.

    Raises DriverError where nobody answers in any of them.
    """
    took_s: list[float] = []
    now, first = clock.now, servo_ids[0]
    budget_s = BUDGET_S * len(servo_ids) + 2.0 * on_wire_s
    before = Counter(bus.counters.faults())
    gc.collect()
    gc.freeze()
    cpu_s, begin_s = time.process_time(), clock.now()
    last_s = begin_s
    for _ in range(cycles):
        readings = bus.exchange(goals, servo_ids, last_s + budget_s)
        now_s = now()
        if readings[first].__class__ is ServoState or _anybody(readings):
            took_s.append(now_s - last_s)
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
        raise DriverError(
            f"{bus.name}: nobody answered in any of {cycles} cycles: check the cable and the servos' power"
        )
    return _figures(sorted(took_s), cpu_s / cycles, on_wire_s, dict(faults))


def _anybody(readings: Mapping[int, Reading]) -> bool:
    return any(isinstance(reading, ServoState) for reading in readings.values())


def _figures(took_s: list[float], cpu_s: float, on_wire_s: float, faults: dict[str, int]) -> Figures:
    count = len(took_s)
    p50_s, p99_s = took_s[count // 2], took_s[min(count - 1, count * 99 // 100)]
    return Figures(
        hz=round(count / sum(took_s), 2),
        p50_us=round(p50_s * 1e6, 1),
        p99_us=round(p99_s * 1e6, 1),
        max_us=round(took_s[-1] * 1e6, 1),
        cpu_us=round(cpu_s * 1e6, 1),
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
