"""Examine one servo that responds to pings: read its state and find its problems. Nothing is written."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from commissioning.scan.identify import Identity, identify, retry_often
from commissioning.scan.problems import Problem, line_trouble, no_group_reads, own_troubles, unknown_model
from commissioning.scan.steps import ScanStep
from drivers.bus.bus import Bus
from drivers.bus.late_replies import HELD_S
from drivers.clock import Clock
from drivers.driver_errors import PortLost, ServoCorrupt, ServoError
from drivers.port import Port
from drivers.protocol import v1
from drivers.servos import ax_mx, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import XL, X
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.feetech import SCS, STS
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Series
from drivers.types import FaultKind, ServoFault, ServoState

MODES: Final[dict[str, tuple[Register, dict[int, str]]]] = {
    STS.name: (sts.operating_mode, {0: "position", 1: "velocity", 2: "PWM", 3: "step"}),
    X.name: (
        x.operating_mode,
        {
            0: "current",
            1: "velocity",
            3: "position",
            4: "extended position",
            5: "current-based position",
            16: "PWM",
        },
    ),
    XL.name: (xl320.control_mode, {1: "wheel", 2: "joint"}),
}
"""Operating mode register and the names of its values, keyed by series."""


def mode_text(series: Series, read: Callable[[Register], int]) -> str:
    """Return the name of the servo's operating mode."""
    if series.name in MODES:
        register, names = MODES[series.name]
        value = read(register)
        return names.get(value, f"unknown ({value})")
    limits = [read(register) for register in series.position_limits]
    if limits == [0, 0]:
        return "wheel" if series is AX_MX else "motor"
    if series is AX_MX and limits == [ax_mx.MULTI_TURN_LIMIT] * 2:
        return "multi-turn"
    return "position"


GOOD: Final = 3
"""Number of valid states that confirm that an ID is unique. When two servos have the same ID, their mixed replies are
invalid."""
TRIES: Final = 10


@dataclass(frozen=True, slots=True)
class ScannedServo:
    """One servo found by the scan. Values that could not be read are None."""

    servo_id: int
    baud: int
    protocol: str
    make: str | None = None
    model: str | None = None
    """Name of the model, as used in robot files; None if the model number is unknown."""
    model_number: int | None = None
    firmware: str | None = None
    voltage_v: float | None = None
    temperature_c: float | None = None
    position_counts: int | None = None
    torque: bool | None = None
    operating_mode: str | None = None
    alarms: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = ()


def examine_servo(port: Port, clock: Clock, step: ScanStep, servo_id: int) -> ScannedServo | None:
    """Examine the servo with this ID at the port's current baud rate. Return None if the servo does not respond."""
    identity: Identity | None = None
    corrupt = False
    try:
        identity = identify(port, clock, step.packets, servo_id)
    except PortLost:
        raise
    except ServoError as error:
        corrupt = isinstance(error, ServoCorrupt)
        clock.sleep_until(clock.now() + HELD_S)  # A late reply must not be mistaken for the reply to a later request.
        port.discard_input()
    # All protocol 1.0 servos reply to the single reads that are used for an SCS.
    unknown = (SCS if step.packets is v1 else X).models[0]
    bus = Bus(port, clock, {servo_id: identity.stand_in if identity else unknown})
    state, kinds = _states(bus, servo_id)
    alone = state is None and identity is not None and bus.needs_single_reads(servo_id)
    if alone:
        state, kinds = _states(bus, servo_id)
    trouble = line_trouble(bus.name, servo_id, kinds, identity, corrupt)
    if trouble and trouble.kind == "no_reads" and not _pings(bus, servo_id):
        return None
    problems = [trouble] if trouble else []
    if alone and identity:
        problems.append(_single_reads(bus, servo_id, identity.series.status_level))
    if identity is None or (state is None and identity.model):
        return ScannedServo(servo_id, step.baud, step.servos, problems=tuple(problems))
    series, name = identity.series, identity.model.name if identity.model else None
    found = ScannedServo(
        servo_id, step.baud, series.protocol.name, series.make, name, identity.number, identity.firmware,
        problems=tuple(problems),
    )  # fmt: skip
    if identity.model is None:
        return replace(found, problems=(*problems, unknown_model(identity)))
    return found if state is None else _with_values(found, bus, identity.model, state)


def _single_reads(bus: Bus, servo_id: int, status_level: Register) -> Problem:
    try:
        return no_group_reads(retry_often(partial(bus.read, servo_id, status_level)), status_level)
    except PortLost:
        raise
    except ServoError:
        return no_group_reads(None, status_level)


def _states(bus: Bus, servo_id: int) -> tuple[ServoState | None, Counter[FaultKind | None]]:
    """Read the state several times. Return the last valid state and the number of outcomes of each type."""
    state: ServoState | None = None
    kinds: Counter[FaultKind | None] = Counter()
    while kinds[None] < GOOD and kinds.total() < TRIES:
        reading = bus.read_states([servo_id])[servo_id]
        kinds[reading.kind if isinstance(reading, ServoFault) else None] += 1
        state = state if isinstance(reading, ServoFault) else reading
    return state, kinds


def _pings(bus: Bus, servo_id: int) -> bool:
    try:
        retry_often(partial(bus.ping, servo_id))
    except PortLost:
        raise
    except ServoError:
        return False
    return True


def _with_values(found: ScannedServo, bus: Bus, model: ServoModel, state: ServoState) -> ScannedServo:
    """Return the servo with its state, torque, mode and problems.

    All values are read using the control table of the servo's model.
    """
    servo_id, series, problems = found.servo_id, series_of(model), list(found.problems)
    torque: int | None = None
    mode: str | None = None

    def read(register: Register) -> int:
        return retry_often(partial(bus.read, servo_id, register))

    try:
        torque, mode = read(series.torque_enable), mode_text(series, read)
        problems += own_troubles(model, state, read)
    except PortLost:
        raise
    except ServoError as error:  # The bus is so unreliable that many attempts have failed.
        problems.append(Problem("bad_line", error.text))
    return replace(
        found,
        voltage_v=round(state.voltage_v, 1),
        temperature_c=state.temperature_c,
        position_counts=state.position_counts,
        torque=None if torque is None else torque == 1,
        operating_mode=mode,
        alarms=state.alarms,
        problems=tuple(problems),
    )
