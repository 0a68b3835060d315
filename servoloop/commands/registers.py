"""Options and output of ``servoloop register``: tables, registers without a name, and servos that respond only to
pings."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.commissioning_errors import CommissioningError
from servoloop.commands.shared.console import JsonOption, confirm, print_json, text_console
from servoloop.commands.shared.line_options import device_of, interruptible
from servoloop.stack.tables import print_table

if TYPE_CHECKING:
    from commissioning.scan.find import FoundServo


def number_of(text: str) -> int:
    """Convert a decimal number, or a hexadecimal number with the prefix 0x. Raises ValueError."""
    return int(text, 16) if text.strip().lower().startswith("0x") else int(text)


def _address(text: str) -> int:
    try:
        address = number_of(text)
    except ValueError:
        raise typer.BadParameter(f"must be a number such as 40 or 0x28, not {text!r}") from None
    if address < 0:
        raise typer.BadParameter(f"must be at least 0, not {address}")
    return address


Span = tuple[int, int]
"""Address and size of a register."""


@dataclass(frozen=True, slots=True)
class RegisterAddress:
    """Options that select a register by address."""

    address: Annotated[
        int | None,
        typer.Option(
            "--address",
            parser=_address,
            metavar="INTEGER",
            help="Address of a register, instead of its name, if the model has no control table. Decimal, or "
            "hexadecimal with 0x.",
        ),
    ] = None
    size: Annotated[int | None, typer.Option("--size", help="Size of the register at --address: 1, 2 or 4 bytes.")] = (
        None
    )

    def span(self) -> Span | None:
        """Return the address and the size, or None if both are omitted.

        Raises CommissioningError if only one is given.
        """
        if self.address is None and self.size is None:
            return None
        if self.address is None or self.size is None:
            raise CommissioningError("--address and --size must be used together: pass both, or the name of a register")
        return self.address, self.size


def name_to_read(name: str | None, span: Span | None) -> str:
    """Return the name of the register to read, or an empty string if an address is given instead.

    Raises CommissioningError unless exactly one of the two is given.
    """
    if (name is None) == (span is None):
        raise CommissioningError("pass the name of a register, or --address and --size")
    return name or ""


def name_and_value(words: list[str], span: Span | None) -> tuple[str, str]:
    """Return the name of the register and the value to write. The name is empty if an address is given.

    Raises CommissioningError for other arguments.
    """
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
    """Convert the value to write to an address. Raises CommissioningError."""
    try:
        return number_of(value)
    except ValueError:
        raise CommissioningError(
            f"with --address, the value must be a whole number such as 40 or 0x28, not {value!r}"
        ) from None


def write_at(servo: "FoundServo", span: Span, value: int, yes: bool, json: bool) -> None:
    """Write a register by its address after confirmation, and print the result."""
    from commissioning.registers.by_address import write_address

    confirm(
        f"servo {servo.servo_id} ({servo.name}): servoloop cannot check what this register does, or whether the torque "
        "of the servo is enabled. Continue?",
        yes,
    )
    written = write_address(servo, *span, value)
    if json:
        print_json(written)
        return
    same = "; nothing was written because the value is the same"
    was = same if written.before == written.after else f", previously {written.before}"
    typer.echo(f"servo {servo.servo_id}: address {written.address} is {written.after}{was}")


ModelOption = Annotated[
    str | None,
    typer.Option(
        "--model", help="Model of a servo that responds only to pings. Its status level is written without a reply."
    ),
]


def write_status_level(port: str | None, servo_id: int, baud: int | None, model: str, words: list[str]) -> None:
    """Make a servo respond to reads again. Raises CommissioningError if the register to write is not the status
    level."""
    from commissioning.registers.mute import answer_reads
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort
    from drivers.servos.catalog import MODELS, model_advice, series_of

    if model not in MODELS:
        raise CommissioningError(f"--model {model} is unknown: {model_advice(model)}")
    series = series_of(MODELS[model])
    if words != [series.status_level.name, str(series.answers_all)]:
        raise CommissioningError(
            f"with --model, only '{series.status_level.name} {series.answers_all}' can be written. Omit --model for a "
            "servo that responds to reads"
        )
    clock = MonotonicClock()
    line = SerialPort(device_of(port), baud or 1_000_000, clock)
    try:
        with interruptible():
            level = answer_reads(line, clock, servo_id, MODELS[model], (baud,) if baud else ())
    finally:
        line.close()
    typer.echo(f"servo {servo_id} responds to reads; its {series.status_level.name} is {level}")


def tables(
    model: Annotated[str | None, typer.Argument(help="Model whose registers are listed (default: all models).")] = None,
    json: JsonOption = False,
) -> None:
    """List all servo models, or the control table of one model. No servo is needed.

    The servo models in the current folder are included (servo_models.yaml, see docs/add-a-servo.md).
    Example: `servoloop register tables xl430-w250`
    """
    from rich.table import Table

    from commissioning.registers.listing import listed_models, listed_registers

    if model is None:
        models = listed_models()
        if json:
            print_json(models)
            return
        table = Table("model", "number", "series", "registers", "source", title="servo models")
        for one in models:
            table.add_row(one.name, str(one.number), one.series, str(one.registers), one.source)
        print_table(text_console(), table, "series")
        return
    registers = listed_registers(model)
    if json:
        print_json(registers)
        return
    table = Table("register", "address", "size", "access", "memory", "values", "unit", title=model)
    for row in registers:
        access, kept = "read, write" if row.writable else "read", "EEPROM" if row.persistent else "RAM"
        table.add_row(row.name, str(row.address), str(row.size), access, kept, row.values, row.unit)
    print_table(text_console(), table, "values")
