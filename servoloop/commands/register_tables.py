"""The command ``register tables``: list the known servo models, or the control table of one of them."""

from typing import Annotated

import typer

from servoloop.commands.console import JsonOption, print_json, print_table


def tables(
    model: Annotated[str | None, typer.Argument(help="Model whose registers are listed (default: all models).")] = None,
    json: JsonOption = False,
) -> None:
    """List all servo models, or the control table of one model. No servo is needed.

    The servo models of the present folder are included (servo_models.yaml, see docs/add-a-servo.md).
    Example: `servoloop register tables xl430-w250`
    """
    from rich.console import Console
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
        print_table(Console(), table, "series")
        return
    registers = listed_registers(model)
    if json:
        print_json(registers)
        return
    table = Table("register", "address", "size", "access", "memory", "values", "unit", title=model)
    for row in registers:
        access, kept = "read, write" if row.writable else "read", "EEPROM" if row.persistent else "RAM"
        table.add_row(row.name, str(row.address), str(row.size), access, kept, row.values, row.unit)
    print_table(Console(), table, "values")
