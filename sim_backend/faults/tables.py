"""Look up registers of all models by name, and draw random register values."""

from random import Random
from typing import Final

from drivers.servos.catalog import registers_of
from drivers.servos.register import Register, ServoModel
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.tails import either_way, log_uniform

ZERO: Final = 0.15
"""Fraction of the drawn values that are 0."""


def register_of(model: ServoModel, name: str) -> Register:
    """Return a register of a model. Raises FaultError if the model has no register with this name."""
    for register in registers_of(model):
        if register.name == name:
            return register
    raise FaultError(f"an {model.name} has no register {name!r}: `servoloop register list` lists its registers")


def require_value(register: Register, value: int) -> None:
    """Raise FaultError if the register cannot have this value."""
    fitting = register.fitting
    if value not in fitting:
        raise FaultError(f"{register.name} must be {fitting.start} to {fitting.stop - 1}, not {value}")


def any_value(random: Random, register: Register) -> int:
    """Draw a value that fits in the register: 0, or a small or large number of either sign."""
    if random.random() < ZERO:
        return 0
    size = round(log_uniform(random, 1.0, float(register.largest)))
    return round(either_way(random, size)) if register.smallest < 0 else size
