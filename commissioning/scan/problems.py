"""Find the problems of a servo that responds. Each problem has a message that tells the user what to do."""

from collections import Counter
from dataclasses import dataclass
from typing import Final, Literal

from commissioning.scan.identify import Identity
from drivers.port.latency import HELD_BACK, latency_advice
from drivers.port.owners import line_advice
from drivers.servos.catalog import series_of, unsupported
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Read, Series
from drivers.types import FaultKind, ServoState

Kind = Literal[
    "alarmed",
    "wrong_mode",
    "unknown_model",
    "collision",
    "bad_line",
    "late",
    "no_reads",
    "no_group_reads",
    "no_state",
    "other_rate",
    "wrong_model",
    "absent",
]
BAD_SHARE: Final = 0.5
"""Minimum fraction of failed reads at which the bus is considered unreliable."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A problem and its solution."""

    kind: Kind
    text: str


def line_trouble(
    port: str, servo_id: int, kinds: Counter[FaultKind | None], identity: Identity | None, corrupt: bool
) -> Problem | None:
    """Return the problem that explains the outcomes of reading a servo's state; None if there is no problem.

    Args:
        port: Name of the port.
        servo_id: ID of the servo.
        kinds: Number of outcomes of each type.
        identity: Identity of the servo; None if it could not be read.
        corrupt: Whether the reply to the identity request was corrupted.
    """
    failed = kinds.total() - kinds[None]
    if kinds[None] == 0 and kinds["corrupt"] == failed and failed:
        return collision(servo_id, port)
    # The first reply after a silence also counts as late, because it may belong to an earlier request.
    never_in_time = kinds[None] == kinds["corrupt"] == 0 and kinds["late"] > 0
    if never_in_time or kinds["late"] > 1 + kinds[None]:
        return Problem("late", f"its replies arrive too late: {latency_advice(port) or HELD_BACK}")
    if kinds[None] == 0 and kinds["corrupt"] == 0:
        if corrupt:
            return collision(servo_id, port)
        return (
            Problem("no_reads", _no_reads_text(servo_id, port))
            if identity is None
            else Problem("no_state", _no_state_text(identity))
        )
    if failed >= BAD_SHARE * kinds.total():
        advice = line_advice(port, "the plugs of the cables, and the supply")
        return Problem("bad_line", f"many of its replies are lost or corrupted: check {advice}")
    return None


def _no_reads_text(servo_id: int, port: str) -> str:
    """Describe a servo that responds only to pings."""
    return (
        "it responds to pings but not to reads. If it is a Dynamixel, its status return level may be 0: set it with "
        f"'servoloop register write --port {port} --id {servo_id} --model MODEL status_return_level 2'. A Dynamixel X "
        "also responds after its supply was off"
    )


def _no_state_text(identity: Identity) -> str:
    block = identity.series.blocks[0]
    return (
        f"it responds to reads of its model number ({identity.number}), but not to reads of its state (registers "
        f"{block.address} to {block.address + block.size - 1}): its control table differs from the table of the series "
        f"{identity.series.name}"
    )


def no_group_reads(level: int | None, register: Register) -> Problem:
    """Return the problem of a servo that responds only to single reads.

    Args:
        level: Value of the servo's status return level; None if it could not be read.
        register: The status return level register.
    """
    held = f" ({register.name}, register {register.address}, is {level})" if level is not None else ""
    return Problem(
        "no_group_reads",
        f"it responds to single reads, but not to group reads (sync read). This is not a setting{held}: its firmware "
        f"lacks the instruction, as in many self-made servos. servoloop reads and writes it with single requests, "
        "which takes longer in each cycle",
    )


def collision(servo_id: int, port: str) -> Problem:
    """Return the problem of two servos that probably have the same ID."""
    return Problem(
        "collision",
        f"all of its replies are corrupted, so probably two servos have ID {servo_id}. Leave only one of them plugged "
        f"in and give it another ID: servoloop set-id {servo_id} NEW --port {port}. If there is only one, check "
        f"{line_advice(port)}",
    )


VOLTAGE_LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))


def own_troubles(model: ServoModel, state: ServoState, read: Read) -> list[Problem]:
    """Return the problems of the servo itself: its mode and alarms. ``read`` reads a register of the servo."""
    series, problems = series_of(model), list[Problem]()
    if wrong := series.config_error(model, read):
        problems.append(Problem("wrong_mode", f"it {wrong}"))
    if state.alarms:
        problems.append(Problem("alarmed", _alarm_text(series, state, read)))
    return problems


def unknown_model(identity: Identity) -> Problem:
    """Return the problem of a servo whose model number is missing from all control tables."""
    return Problem("unknown_model", _unknown_text(identity))


def _unknown_text(identity: Identity) -> str:
    if name := unsupported(identity.number, identity.series):
        return (
            f"{name}: read only, because its control table is not supported (model number {identity.number}). Read "
            "its registers by "
            "address, not by name"
        )
    known = ", ".join(f"{model.name} {model.number}" for model in identity.series.models)
    return (
        f"it reports model number {identity.number}, which is unknown in the series {identity.series.name} ({known}). "
        "Its control table is therefore unknown, and none of its values is shown. To add the model, see "
        "docs/add-a-servo.md"
    )


def _alarm_text(series: Series, state: ServoState, read: Read) -> str:
    text = f"it reports {' and '.join(state.alarms)}"
    if "voltage" not in state.alarms:
        return f"{text}: remove its load or let it cool down, then switch its supply off and on"
    names = {register.name: register for register in series.registers}
    for lowest, highest in VOLTAGE_LIMITS:
        if lowest in names:
            low, high = (0.1 * read(names[name]) for name in (lowest, highest))
            return (
                f"{text}: its supply voltage is {state.voltage_v:.1f} V, and its limits are {low:.1f} to {high:.1f} V. "
                "Check the supply"
            )
    return text
