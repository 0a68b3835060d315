"""A look at one servo that answers pings: its state, and what is wrong with it. Nothing is written."""

from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

from commissioning.scan.identify import Identity, identify, surely
from commissioning.scan.modes import mode_text
from commissioning.scan.steps import Step
from drivers.bus.bus import Bus
from drivers.bus.types import FaultKind, ServoFault, ServoState
from drivers.clock import Clock
from drivers.errors import PortLost, ServoCorrupt, ServoError
from drivers.port import Port
from drivers.port.latency import HELD_BACK, latency_advice
from drivers.protocol import v1
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from drivers.servos.series import Series

Kind = Literal[
    "alarmed", "wrong_mode", "unknown_model", "collision", "bad_line", "late", "no_reads", "other_rate", "absent"
]
GOOD: Final = 3
"""So many states in one piece, and it is one servo: of two with one ID each read is a mixture of two positions."""
TRIES: Final = 10
BAD_SHARE: Final = 0.5


@dataclass(frozen=True, slots=True)
class Problem:
    """What is wrong, and what to do."""

    kind: Kind
    text: str


@dataclass(frozen=True, slots=True)
class ServoLook:
    """One servo as the scan found it. What could not be read is None."""

    servo_id: int
    baud: int
    protocol: str
    make: str | None = None
    model: str | None = None
    """Its name in files; None where the number is unknown."""
    model_number: int | None = None
    firmware: str | None = None
    voltage_v: float | None = None
    temperature_c: float | None = None
    position_counts: int | None = None
    torque: bool | None = None
    operating_mode: str | None = None
    alarms: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = ()


def look(port: Port, clock: Clock, step: Step, servo_id: int) -> ServoLook | None:
    """The servo with this ID at the step's rate, which is the port's. None where it answers nothing after all."""
    identity: Identity | None = None
    corrupt = False
    try:
        identity = identify(port, clock, step.packets, servo_id)
    except PortLost:
        raise
    except ServoError as error:
        corrupt = isinstance(error, ServoCorrupt)
    series = identity.series if identity else STS if step.packets is v1 else X
    bus = Bus(port, clock, {servo_id: identity.stand_in if identity else series.models[0]})
    state, kinds = _states(bus, servo_id)
    trouble = _line_trouble(bus.name, servo_id, kinds, corrupt)
    if trouble and trouble.kind == "no_reads" and not _pings(bus, servo_id):
        return None
    if identity is None or state is None:
        return ServoLook(servo_id, step.baud, series.protocol.name, problems=(trouble,) if trouble else ())
    return _looked(bus, servo_id, step, identity, state, trouble)


def _states(bus: Bus, servo_id: int) -> tuple[ServoState | None, Counter[FaultKind | None]]:
    """Its state, and how each try ended."""
    state: ServoState | None = None
    kinds: Counter[FaultKind | None] = Counter()
    while kinds[None] < GOOD and kinds.total() < TRIES:
        reading = bus.read_states([servo_id])[servo_id]
        kinds[reading.kind if isinstance(reading, ServoFault) else None] += 1
        state = state if isinstance(reading, ServoFault) else reading
    return state, kinds


def _line_trouble(port: str, servo_id: int, kinds: Counter[FaultKind | None], corrupt: bool) -> Problem | None:
    """What the tries say of the line rather than of the servo."""
    failed = kinds.total() - kinds[None]
    if kinds[None] == 0 and kinds["corrupt"] == failed and failed:
        return _collision(servo_id)
    if kinds["late"] > 1 + kinds[None]:
        return Problem("late", f"answers too late: {latency_advice(port) or HELD_BACK}")
    if kinds[None] == 0 and kinds["corrupt"] == 0:
        return (
            _collision(servo_id)
            if corrupt
            else Problem("no_reads", "answers a ping but no read: set its status return level so that it answers reads")
        )
    if failed >= BAD_SHARE * kinds.total():
        return Problem("bad_line", "answers now and then, and broken: check the cable's plugs and the supply")
    return None


def _collision(servo_id: int) -> Problem:
    return Problem(
        "collision",
        f"answers, but never in one piece: two servos probably have ID {servo_id}. Unplug all of them but one and give "
        f"that another ID: servoloop set-id {servo_id} NEW. If there is only one, check the cable's plugs",
    )


def _pings(bus: Bus, servo_id: int) -> bool:
    try:
        surely(partial(bus.ping, servo_id))
    except PortLost:
        raise
    except ServoError:
        return False
    return True


def _looked(
    bus: Bus, servo_id: int, step: Step, identity: Identity, state: ServoState, trouble: Problem | None
) -> ServoLook:
    series, problems = identity.series, [trouble] if trouble else []
    torque: int | None = None
    mode = wrong = None
    try:
        torque = surely(partial(bus.read, servo_id, series.torque_enable))
        mode = mode_text(series, lambda register: surely(partial(bus.read, servo_id, register)))
        wrong = series.config_error(identity.stand_in, lambda register: surely(partial(bus.read, servo_id, register)))
    except PortLost:
        raise
    except ServoError as error:
        problems.append(Problem("bad_line", f"{error.text}"))
    if identity.model is None:
        problems.append(Problem("unknown_model", _unknown(identity)))
    elif wrong:
        problems.append(Problem("wrong_mode", wrong))
    if state.alarms:
        problems.append(Problem("alarmed", _alarm_text(bus, servo_id, series, state)))
    return ServoLook(
        servo_id, step.baud, series.protocol.name, series.make,
        identity.model.name if identity.model else None, identity.number, identity.firmware,
        round(state.voltage_v, 1), state.temperature_c, state.position_counts,
        None if torque is None else torque == 1, mode, state.alarms, tuple(problems),
    )  # fmt: skip


def _unknown(identity: Identity) -> str:
    known = ", ".join(f"{model.name} {model.number}" for model in identity.series.models)
    return (
        f"says model number {identity.number}, which is none of the series {identity.series.name} that are known here "
        f"({known}); it was read by that series' table"
    )


_LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))


def _alarm_text(bus: Bus, servo_id: int, series: Series, state: ServoState) -> str:
    text = f"reports {' and '.join(state.alarms)}"
    if "voltage" not in state.alarms:
        return f"{text}: take the load off or let it cool, then switch its supply off and on"
    names = {register.name: register for register in series.registers}
    for lowest, highest in _LIMITS:
        if lowest in names:
            low, high = (0.1 * surely(partial(bus.read, servo_id, names[name])) for name in (lowest, highest))
            return f"{text}: it has {state.voltage_v:.1f} V and its limits are {low:.1f} to {high:.1f} V"
    return text
