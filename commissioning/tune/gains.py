"""Parse, read and write the gains of a servo's position loop by their common names, such as P, I and D."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.eeprom import HOLDS, EepromError, update
from drivers.servos.catalog import registers_of, series_of
from drivers.servos.register import Access, Register, ServoModel
from hal.compensation.servo_compliance import assumed_settings
from hal.joint import Joint
from hal.servos.servo_settings import settings_of


class TuneError(CommissioningError):
    """A joint cannot be measured, or a gain cannot be set to the requested value."""


LETTERS: Final[Mapping[str, tuple[str, ...]]] = {
    "P": ("position_p", "position_p_gain", "p_gain"),
    "I": ("position_i", "position_i_gain", "i_gain"),
    "D": ("position_d", "position_d_gain", "d_gain"),
}
OTHERS: Final = ("cw_dead_zone", "ccw_dead_zone", "minimum_startup_force")
BOTH: Final[Mapping[str, tuple[str, ...]]] = {"dead_zone": ("cw_dead_zone", "ccw_dead_zone")}
"""Gain names that each set several registers."""
_PAIR: Final = re.compile(r"(\w+)=(\d+)")


def gains_of(model: ServoModel) -> dict[str, Register]:
    """Return the gain registers of a servo model, keyed by name. The result is empty if the model does not have any."""
    table = {register.name: register for register in registers_of(model) if register.access is Access.READ_WRITE}
    found = {letter: table[name] for letter, names in LETTERS.items() for name in names if name in table}
    return found | {name: table[name] for name in OTHERS if name in table}


def parse_gains(model: ServoModel, words: Sequence[str]) -> dict[str, int]:
    """Parse gains such as ``P=24 D=32``, given as one string or several. Raises TuneError listing all errors."""
    known = gains_of(model)
    if not known:
        raise TuneError(f"an {model.name} has no adjustable gains")
    names = [*known, *(both for both, parts in BOTH.items() if set(parts) <= known.keys())]
    found: dict[str, int] = {}
    problems: list[str] = []
    for word in re.split(r"[\s,]+", " ".join(words).strip()):
        match = _PAIR.fullmatch(word)
        name = match[1].upper() if match and match[1].upper() in LETTERS else match[1] if match else ""
        if match is None or name not in names:
            problems.append(f"{word!r} is not a gain: write one of {', '.join(names)} with its value, as in P=24")
            continue
        found |= dict.fromkeys(BOTH.get(name, (name,)), int(match[2]))
    problems += [problem for name, value in found.items() if (problem := _misfit(name, known[name], value))]
    if problems:
        raise TuneError(f"{model.name}: {'; '.join(problems)}")
    return found


def _misfit(name: str, register: Register, value: int) -> str:
    smallest = 1 if name == "P" else max(register.smallest, 0)  # A servo with P = 0 does not exert any force.
    if smallest <= value <= register.largest:
        return ""
    return f"{name} must be {smallest} to {register.largest}, not {value}"


def read_gains(bus: Bus, joint: Joint) -> dict[str, int]:
    """Read the gains of the joint's servo, keyed by name. Raises ServoError.

    If P is in RAM and the robot file specifies it, return the robot file's value, because the stack writes this value
    when it enables torque.
    """
    known = gains_of(joint.model)
    held = {name: retry(partial(bus.read, joint.servo_id, register)) for name, register in known.items()}
    return held if joint.position_p is None else {**held, "P": joint.position_p}


def as_held(bus: Bus, joint: Joint) -> Joint:
    """Return the joint with its servo's current settings, so that activation does not write any settings. Raises
    ServoError."""
    known = {register.name: register for register in registers_of(joint.model)}
    stored = settings_of(joint.model)
    names = [*assumed_settings(joint.model), *(r.name for r in gains_of(joint.model).values() if r.name in stored)]
    settings = {name: retry(partial(bus.read, joint.servo_id, known[name])) for name in dict.fromkeys(names)}
    held = replace(joint, settings=tuple(settings.items()))
    register = series_of(joint.model).position_p
    if register is None or joint.position_p is not None:
        return held
    return replace(held, position_p=retry(partial(bus.read, joint.servo_id, register)))


def with_gains(joint: Joint, values: Mapping[str, int]) -> Joint:
    """Return a copy of the joint with these gains."""
    known, stored = gains_of(joint.model), settings_of(joint.model)
    saved = {known[name].name: value for name, value in values.items() if known[name].name in stored}
    in_ram = series_of(joint.model).position_p is not None and "P" in values
    return replace(
        joint,
        settings=tuple({**dict(joint.settings), **saved}.items()),
        position_p=values["P"] if in_ram else joint.position_p,
    )


@dataclass(frozen=True, slots=True)
class Written:
    """One gain that was changed."""

    gain: str
    register: str
    old: int
    new: int


def write_gains(bus: Bus, joint: Joint, values: Mapping[str, int]) -> tuple[Written, ...]:
    """Write these gains to the joint's servo and return the changes.

    Raises ServoError if the servo's torque is enabled or the servo does not accept a gain, and PortLost if the port
    disappears.
    """
    known = gains_of(joint.model)
    names = {known[name]: name for name in values}
    saved = {register: values[name] for register, name in names.items() if register.persistent}
    changes = update(bus, joint.servo_id, series_of(joint.model).lock, saved) if saved else ()
    done = [Written(names[one.register], one.register.name, one.old, one.new) for one in changes]
    for register, name in names.items():
        if not register.persistent and (old := _set(bus, joint, register, values[name])) is not None:
            done.append(Written(name, register.name, old, values[name]))
    return tuple(done)


def _set(bus: Bus, joint: Joint, register: Register, value: int) -> int | None:
    """Write a RAM register and return its old value; None if it already contains the value."""
    held = partial(bus.read, joint.servo_id, register)
    old = retry(held)
    if old == value:
        return None
    if bus.torque_is_on(joint.servo_id):
        raise EepromError(joint.servo_id, register, f"is not written: {HOLDS}")
    retry(partial(bus.write, joint.servo_id, register, value))
    if (now := retry(held)) != value:
        raise EepromError(joint.servo_id, register, f"is still {now}, because the servo does not accept {value}")
    return old
