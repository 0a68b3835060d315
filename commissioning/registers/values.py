"""Values of registers, raw and in units, from and to what people write."""

import re
from dataclasses import dataclass
from typing import Final

from commissioning.errors import CommissioningError
from commissioning.registers.tables import meaning
from commissioning.registers.units import unit_of
from drivers.servos.register import Access, Register, ServoModel

_QUANTITY: Final = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*(\S*)\s*")
_SPELLED: Final = {"c": "°c", "degc": "°c", "us": "µs", "μs": "µs", "counts/s^2": "counts/s²", "rev/min^2": "rev/min²"}
"""What a keyboard has instead."""


@dataclass(frozen=True, slots=True)
class RegisterValue:
    """One register and what it holds. ``raw`` is None where the servo refuses to tell."""

    name: str
    address: int
    size: int
    writable: bool
    persistent: bool
    raw: int | None
    value: float | None
    unit: str
    meaning: str

    @property
    def text(self) -> str:
        """For people: the quantity, or what the number means, or the number."""
        if self.raw is None:
            return "not readable"
        if self.unit:
            return f"{self.value:.6g} {self.unit}"
        return f"{self.raw} ({self.meaning})" if self.meaning else str(self.raw)


def value_of(model: ServoModel, register: Register, raw: int | None) -> RegisterValue:
    """A register's value in its unit."""
    unit = unit_of(model, register)
    return RegisterValue(
        register.name,
        register.address,
        register.size,
        register.access is Access.READ_WRITE,
        register.persistent,
        raw,
        None if raw is None else round(raw * unit.scale, 6),
        unit.symbol,
        "" if raw is None else meaning(model, register, raw),
    )


def parse(model: ServoModel, register: Register, text: str) -> int:
    """The raw value that is meant: a whole number is one, a quantity such as ``12.1V`` has its unit with it."""
    unit = unit_of(model, register)
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise CommissioningError(f"{register.name} takes a number{_or_quantity(unit.symbol)}, not {text!r}")
    number, symbol = match.groups()
    said = _SPELLED.get(symbol.lower(), symbol.lower())
    if said and said != unit.symbol.lower():
        has = f"is in {unit.symbol}" if unit.symbol else "has no unit"
        raise CommissioningError(f"{register.name} {has}, not in {symbol}")
    if not said and "." in number:
        raise CommissioningError(f"{register.name} takes a whole number{_or_quantity(unit.symbol)}, not {text!r}")
    raw = round(float(number) / unit.scale) if said else int(number)
    try:
        register.check(raw)
    except ValueError as error:
        raise CommissioningError(str(error)) from error
    return raw


def _or_quantity(symbol: str) -> str:
    return f" (as the servo counts), or a quantity with its unit {symbol}" if symbol else ""
