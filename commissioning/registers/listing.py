"""List the known servo models and their control tables. No servo needs to be connected."""

from dataclasses import dataclass

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.values import unit_of
from drivers.servos.catalog import MODELS, is_added, model_advice, registers_of, series_of
from drivers.servos.register import Access


@dataclass(frozen=True, slots=True)
class ListedModel:
    """A servo model. ``registers`` is the number of registers in the control table."""

    name: str
    number: int
    series: str
    registers: int
    source: str
    """Origin of the model: ``servoloop``, or the user's file."""


@dataclass(frozen=True, slots=True)
class ListedRegister:
    """A register of a control table."""

    name: str
    address: int
    size: int
    writable: bool
    persistent: bool
    values: str
    """Raw values that the servo accepts; empty if the register is read-only."""
    unit: str


def listed_models() -> tuple[ListedModel, ...]:
    """List all models known to servoloop.

    Returns:
        The models, sorted by series. Within each series, the user's models come last.
    """
    return tuple(
        ListedModel(
            model.name,
            model.number,
            series_of(model).name,
            len(registers_of(model)),
            "servo_models.yaml" if is_added(model) else "servoloop",
        )
        for model in sorted(MODELS.values(), key=lambda model: series_of(model).name)
    )


def listed_registers(name: str) -> tuple[ListedRegister, ...]:
    """List the control table of a model.

    Args:
        name: Name of the model, as used in robot files.

    Returns:
        The model's registers, sorted by address.

    Raises:
        CommissioningError: The model is unknown. The message lists similar names.
    """
    if name not in MODELS:
        raise CommissioningError(f"unknown servo model {name}: {model_advice(name)}")
    model = MODELS[name]
    return tuple(
        ListedRegister(
            register.name,
            register.address,
            register.size,
            register.access is Access.READ_WRITE,
            register.persistent,
            register.values_text if register.access is Access.READ_WRITE else "",
            unit_of(model, register).symbol,
        )
        for register in registers_of(model)
    )
