"""What can be wrong with a servo that answers, each in words that say what to do."""

from collections import Counter
from dataclasses import dataclass
from typing import Final, Literal

from commissioning.scan.identify import Identity
from drivers.bus.types import FaultKind, ServoState
from drivers.port.latency import HELD_BACK, latency_advice
from drivers.port.owners import line_advice
from drivers.servos.series import Read, Series

Kind = Literal[
    "alarmed",
    "wrong_mode",
    "unknown_model",
    "collision",
    "bad_line",
    "late",
    "no_reads",
    "other_rate",
    "wrong_model",
    "absent",
]
BAD_SHARE: Final = 0.5
"""From this share of failed tries on the line is called bad."""


@dataclass(frozen=True, slots=True)
class Problem:
    """What is wrong, and what to do."""

    kind: Kind
    text: str


def line_trouble(port: str, servo_id: int, kinds: Counter[FaultKind | None], corrupt: bool) -> Problem | None:
    """What the tries say of the line rather than of the servo."""
    failed = kinds.total() - kinds[None]
    if kinds[None] == 0 and kinds["corrupt"] == failed and failed:
        return collision(servo_id, port)
    # A first one that comes after a silence counts as late too, for it may be.
    never_in_time = kinds[None] == kinds["corrupt"] == 0 and kinds["late"] > 0
    if never_in_time or kinds["late"] > 1 + kinds[None]:
        return Problem("late", f"answers too late: {latency_advice(port) or HELD_BACK}")
    if kinds[None] == 0 and kinds["corrupt"] == 0:
        return (
            collision(servo_id, port)
            if corrupt
            else Problem("no_reads", "answers a ping but no read: set its status return level so that it answers reads")
        )
    if failed >= BAD_SHARE * kinds.total():
        advice = line_advice(port, "the cable's plugs and the supply")
        return Problem("bad_line", f"answers now and then, and broken: check {advice}")
    return None


def collision(servo_id: int, port: str) -> Problem:
    """Two servos with one ID, as far as one can tell."""
    return Problem(
        "collision",
        f"answers, but never in one piece: two servos probably have ID {servo_id}. Unplug all of them but one and give "
        f"that another ID: servoloop set-id {servo_id} NEW. If there is only one, check {line_advice(port)}",
    )


VOLTAGE_LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))


def own_troubles(identity: Identity, state: ServoState, read: Read) -> list[Problem]:
    """What is wrong with the servo itself: its model, its mode, its alarms. ``read`` reads one of its registers."""
    problems: list[Problem] = []
    if identity.model is None:
        problems.append(Problem("unknown_model", _unknown_text(identity)))
    elif wrong := identity.series.config_error(identity.model, read):
        problems.append(Problem("wrong_mode", wrong))
    if state.alarms:
        problems.append(Problem("alarmed", _alarm_text(identity.series, state, read)))
    return problems


def _unknown_text(identity: Identity) -> str:
    known = ", ".join(f"{model.name} {model.number}" for model in identity.series.models)
    return (
        f"says model number {identity.number}, which is none of the series {identity.series.name} that are known here "
        f"({known}); it was read by that series' table"
    )


def _alarm_text(series: Series, state: ServoState, read: Read) -> str:
    text = f"reports {' and '.join(state.alarms)}"
    if "voltage" not in state.alarms:
        return f"{text}: take the load off or let it cool, then switch its supply off and on"
    names = {register.name: register for register in series.registers}
    for lowest, highest in VOLTAGE_LIMITS:
        if lowest in names:
            low, high = (0.1 * read(names[name]) for name in (lowest, highest))
            return f"{text}: it has {state.voltage_v:.1f} V and its limits are {low:.1f} to {high:.1f} V"
    return text
