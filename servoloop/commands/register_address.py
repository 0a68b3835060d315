"""``servoloop register read`` and ``write`` with ``--address``, for registers that have no name here."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.errors import CommissioningError
from servoloop.commands.console import confirm, print_json

if TYPE_CHECKING:
    from commissioning.scan.find import FoundServo

Span = tuple[int, int]
"""Address and size of a register."""


@dataclass(frozen=True, slots=True)
class RegisterAddress:
    """Options that select a register by its address."""

    address: Annotated[
        int | None,
        typer.Option(
            "--address", min=0, help="Address of a register, instead of its name, for a model without a table."
        ),
    ] = None
    size: Annotated[int | None, typer.Option("--size", help="Size of the register at --address: 1, 2 or 4 bytes.")] = (
        None
    )

    def span(self) -> Span | None:
        """Return the address and the size if both are given, or None. Raises CommissioningError if one is missing."""
        if self.address is None and self.size is None:
            return None
        if self.address is None or self.size is None:
            raise CommissioningError("--address and --size belong together: pass both, or the name of a register")
        return self.address, self.size


def name_to_read(name: str | None, span: Span | None) -> str:
    """Return the name of the register to read; empty with an address. Raises CommissioningError unless one is given."""
    if (name is None) == (span is None):
        raise CommissioningError("pass the name of a register, or --address and --size")
    return name or ""


def name_and_value(words: list[str], span: Span | None) -> tuple[str, str]:
    """Return the name, which is empty with an address, and the value. Raises CommissioningError for other arguments."""
    if len(words) != (2 if span is None else 1):
        raise CommissioningError("pass a name and a value, or --address, --size and a value")
    return ("" if span else words[0]), words[-1]


def print_address(servo: "FoundServo", span: Span, json: bool) -> None:
    """Read a register by its address and print its value."""
    from commissioning.registers.by_address import read_address

    value = read_address(servo, *span)
    if json:
        print_json(value)
    else:
        typer.echo(f"address {value.address}: {value.raw}")


def whole_number(value: str) -> int:
    """Convert the value for an address. Raises CommissioningError."""
    try:
        return int(value)
    except ValueError:
        raise CommissioningError(f"with --address, the value must be a whole number, not {value!r}") from None


def write_at(servo: "FoundServo", span: Span, value: int, yes: bool, json: bool) -> None:
    """Write a register by its address after a confirmation, and print the result."""
    from commissioning.registers.by_address import write_address

    confirm(
        f"servo {servo.servo_id} ({servo.name}): servoloop cannot check what this register does, nor whether the servo "
        "holds torque: continue?",
        yes,
    )
    written = write_address(servo, *span, value)
    if json:
        print_json(written)
        return
    same = "; nothing was written because the value is the same"
    was = same if written.before == written.after else f", previously {written.before}"
    typer.echo(f"servo {servo.servo_id}: address {written.address} is {written.after}{was}")
