"""The control tables of all models, by name."""

from collections.abc import Sequence
from random import Random
from typing import Final

from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from sim_backend.faults.errors import FaultError
from sim_backend.faults.tails import either_way, log_uniform

ZERO: Final = 0.15
"""Share of the drawn values that are 0."""


def registers_of(model: ServoModel) -> Sequence[Register]:
    """All registers of a model, by address."""
    return x.registers(model) if isinstance(model, x.Model) else series_of(model).registers


def register_of(model: ServoModel, name: str) -> Register:
    """A model's register. Raises FaultError where it has none of this name."""
    for register in registers_of(model):
        if register.name == name:
            return register
    raise FaultError(f"a {model.name} has no register {name!r}: `servoloop register list` names those that it has")


def require_value(register: Register, value: int) -> None:
    """Raise FaultError where the register cannot have this value."""
    if not register.smallest <= value <= register.largest:
        raise FaultError(f"{register.name} takes {register.smallest} to {register.largest}, not {value}")


def any_value(random: Random, register: Register) -> int:
    """A value that the register may have: 0, or small or large with either sign."""
    if random.random() < ZERO:
        return 0
    size = round(log_uniform(random, 1.0, float(register.largest)))
    return round(either_way(random, size)) if register.smallest < 0 else size
