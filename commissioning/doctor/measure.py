"""The measuring of one bus: who is there, the whole tables, states at rest, the line. Only pings and reads."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from commissioning.doctor.hearing import Hearing, hear
from commissioning.doctor.line_quality import hears_itself, line_figures
from commissioning.doctor.search import Search, search_line
from commissioning.doctor.snapshot import BusSnapshot, PortProblem, ServoSnapshot
from commissioning.doctor.table import read_table
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import PortBusy, PortDenied, PortError, PortLost, PortMissing, PortNotSerial
from drivers.port import Port
from drivers.servos.catalog import series_of
from hal.joint import Joint

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
"""Opens a device at a rate."""


def measure_bus(
    name: str,
    device: str,
    baud: int,
    joints: Sequence[Joint],
    open_port: OpenPort,
    clock: Clock,
    search: Search = search_line,
) -> BusSnapshot:
    """Measure the servos of these joints. What goes wrong with the port stands in the result."""
    empty = BusSnapshot(name, device, baud)
    try:
        port = open_port(device, baud)
    except PortError as error:
        return _failed(empty, error)
    try:
        return _measured(empty, port, joints, clock, search)
    except PortError as error:
        return _failed(empty, error)
    finally:
        port.close()


def _failed(snapshot: BusSnapshot, error: PortError) -> BusSnapshot:
    problem = next(problem for kind, problem in PROBLEMS if isinstance(error, kind))
    return replace(snapshot, problem=problem, problem_text=str(error))


def _measured(snapshot: BusSnapshot, port: Port, joints: Sequence[Joint], clock: Clock, search: Search) -> BusSnapshot:
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
    found = search(port, clock, series_of(joints[0].model).make, missing, tuple(models))
    servos = [replace(servo, elsewhere_baud=found.bauds.get(servo.joint.servo_id)) for servo in servos]
    return replace(snapshot, servos=tuple(servos), strangers=found.strangers, line=line)


def _servo(bus: Bus, joint: Joint, hearing: Hearing) -> ServoSnapshot:
    registers: Mapping[str, int] = {}
    if hearing.states:
        registers = read_table(bus, joint.servo_id, series_of(joint.model))
    turn = joint.model.counts_per_turn
    states = [
        one._replace(position_counts=one.position_counts % turn) if joint.extended else one for one in hearing.states
    ]
    return ServoSnapshot(joint, hearing.heard, registers, tuple(states), bus.name)
