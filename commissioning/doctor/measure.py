"""Measure one bus: its quality, and the control tables and states at rest of its servos.

Only pings and reads are sent.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

from commissioning.doctor.line_quality import Hearing, hear, hears_itself, line_figures
from commissioning.doctor.snapshot import BusSnapshot, PortProblem, ServoSnapshot, Stranger, counts_at_activation
from commissioning.scan.scan import ScanScope, scan
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.driver_errors import PortBusy, PortDenied, PortError, PortLost, PortMissing, PortNotSerial, ServoError
from drivers.port import Port
from drivers.servos.catalog import Make, has_table, series_of
from drivers.servos.register import Access, ByteOrder, Register
from drivers.servos.series import Series
from hal.joint import Joint


@dataclass(frozen=True, slots=True)
class SearchResult:
    """Result of the search for missing and unexpected servos."""

    bauds: Mapping[int, int] = field(default_factory=dict)
    """Baud rates of missing servos, keyed by ID."""
    strangers: tuple[Stranger, ...] = ()
    """Servos that do not belong to a joint."""


def search_line(port: Port, clock: Clock, make: Make, missing: Sequence[int], known: Sequence[int]) -> SearchResult:
    """Search for missing servos at all baud rates of their make, and for unexpected servos at the port's own rate.

    Raises PortLost.
    """
    former = port.baud
    elsewhere = scan(port, clock, ScanScope(servo_ids=missing, makes=(make,))).servos if missing else ()
    here = scan(port, clock, ScanScope(bauds=(former,), makes=(make,))).servos
    strangers = tuple(Stranger(one.servo_id, one.baud, one.model) for one in here if one.servo_id not in known)
    return SearchResult({one.servo_id: one.baud for one in elsewhere if one.baud != former}, strangers)


LARGEST_BLOCK: Final = 60
LARGEST_GAP: Final = 8
"""Maximum number of consecutive undocumented bytes in a block. Servos also return these bytes, so they are read along
with the registers."""


def read_table(bus: Bus, servo_id: int, series: Series) -> Mapping[str, int]:
    """Return the values of all readable registers, keyed by name. Raises PortLost if the port disappears."""
    values: dict[str, int] = {}
    for block in blocks(series.registers):
        values |= _read_block(bus, servo_id, block, series.protocol.byte_order)
    return values


def blocks(registers: Sequence[Register]) -> Iterator[tuple[Register, ...]]:
    """Group registers, sorted by address, into blocks that can each be read with one request."""
    run: list[Register] = []
    for register in registers:
        end = run[-1].address + run[-1].size if run else 0
        too_long = run and register.address + register.size - run[0].address > LARGEST_BLOCK
        if run and (register.address - end > LARGEST_GAP or too_long):
            yield tuple(run)
            run = []
        run.append(register)
    if run:
        yield tuple(run)


def _read_block(bus: Bus, servo_id: int, block: Sequence[Register], order: ByteOrder) -> Mapping[str, int]:
    start = block[0].address
    size = max(register.address + register.size for register in block) - start
    try:
        whole = retry(partial(bus.read, servo_id, Register("block", start, size, Access.READ)))
    except ServoError:
        return _one_by_one(bus, servo_id, block) if len(block) > 1 else {}
    data = whole.to_bytes(size, order)
    return {
        register.name: register.decode(data[register.address - start :][: register.size], order) for register in block
    }


def _one_by_one(bus: Bus, servo_id: int, block: Sequence[Register]) -> Mapping[str, int]:
    """Read the registers of a block individually.

    A servo with an older control table does not respond to requests beyond the end of the table, but its other
    registers can be read.
    """
    values: dict[str, int] = {}
    for register in block:
        try:
            values[register.name] = retry(partial(bus.read, servo_id, register))
        except ServoError:
            if not values:
                break  # The first read has also failed, so the servo itself does not respond.
    return values


PROBLEMS: Final[tuple[tuple[type[PortError], PortProblem], ...]] = (
    (PortMissing, "missing"),
    (PortNotSerial, "not_serial"),
    (PortDenied, "denied"),
    (PortBusy, "busy"),
    (PortLost, "lost"),
    (PortError, "unsuitable"),
)
DELAYS: Final = ("return_delay", "return_delay_time")
OpenPort = Callable[[str, int], Port]
"""Function that opens a device at a baud rate."""


def measure_bus(
    name: str,
    device: str,
    baud: int,
    joints: Sequence[Joint],
    open_port: OpenPort,
    clock: Clock,
) -> BusSnapshot:
    """Measure the servos of these joints. A problem with the port is reported as part of the result."""
    empty = BusSnapshot(name, device, baud)
    try:
        port = open_port(device, baud)
    except PortError as error:
        return _failed(empty, error)
    try:
        return _measured(empty, port, joints, clock)
    except PortError as error:
        return _failed(empty, error)
    finally:
        port.close()


def _failed(snapshot: BusSnapshot, error: PortError) -> BusSnapshot:
    problem = next(problem for kind, problem in PROBLEMS if isinstance(error, kind))
    return replace(snapshot, problem=problem, problem_text=str(error))


def _measured(snapshot: BusSnapshot, port: Port, joints: Sequence[Joint], clock: Clock) -> BusSnapshot:
    models = {joint.servo_id: joint.model for joint in joints}
    protocol = series_of(joints[0].model).protocol
    echoes = hears_itself(port, clock, protocol.packets, joints[0].servo_id)
    bus = Bus(port, clock, models)
    heard = hear(bus, tuple(models), clock)
    servos = [_servo(bus, joint, heard[joint.servo_id]) for joint in joints]
    delays = [value for servo in servos for name in DELAYS if (value := servo.registers.get(name)) is not None]
    steady = {servo.joint.servo_id: servo.joint.model for servo in servos if servo.answers}
    line = line_figures(bus, steady, clock, delays, echoes)
    missing = [servo.joint.servo_id for servo in servos if servo.heard == "silent"]
    found = search_line(port, clock, series_of(joints[0].model).make, missing, tuple(models))
    servos = [replace(servo, elsewhere_baud=found.bauds.get(servo.joint.servo_id)) for servo in servos]
    return replace(snapshot, servos=tuple(servos), strangers=found.strangers, line=line)


def _is_unknown(number: int | None, joint: Joint) -> bool:
    """Return whether this model number is missing from all control tables. All values may then come from the wrong
    addresses."""
    return number is not None and not has_table(number, series_of(joint.model))


def _servo(bus: Bus, joint: Joint, hearing: Hearing) -> ServoSnapshot:
    registers: Mapping[str, int] = {}
    if hearing.states:
        registers = read_table(bus, joint.servo_id, series_of(joint.model))
        if _is_unknown(registers.get("model_number"), joint):
            return ServoSnapshot(joint, hearing.heard, {"model_number": registers["model_number"]}, (), bus.name)
    states = [
        one._replace(position_counts=counts_at_activation(joint.model, registers, one.position_counts))
        for one in hearing.states
    ]
    return ServoSnapshot(joint, hearing.heard, registers, tuple(states), bus.name, alone=hearing.alone)
