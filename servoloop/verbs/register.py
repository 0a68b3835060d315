"""``servoloop register``: registers of one servo by name, with units."""

from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.verbs.line import BaudOption, IdOption, PortOption, servo_at
from servoloop.verbs.output import JsonOption, YesOption, confirm, print_json, print_table

if TYPE_CHECKING:
    from commissioning.registers.values import RegisterValue

NameArgument = Annotated[str, typer.Argument(help="Register, such as present_voltage.")]

app = typer.Typer(no_args_is_help=True, help="Registers of one servo by name, with units.")


@app.command("list")
def list_registers(
    servo_id: IdOption, port: PortOption = None, baud: BaudOption = None, json: JsonOption = False
) -> None:
    """Print the whole table of the servo's model, with present values. Nothing is written.

    Example: `servoloop register list --port /dev/ttyACM0 --id 3`
    """
    from rich.console import Console
    from rich.table import Table

    from commissioning.registers.access import list_registers as read_all

    with servo_at(port, servo_id, baud) as servo:
        values = read_all(servo)
    if json:
        print_json(values)
        return
    table = Table("register", "address", "access", "kept", "value", "raw", title=f"servo {servo_id}: {servo.name}")
    for one in values:
        access, kept = "read, write" if one.writable else "read", "EEPROM" if one.persistent else "RAM"
        table.add_row(one.name, str(one.address), access, kept, one.text, "" if one.raw is None else str(one.raw))
    print_table(Console(), table, "register", "value")


@app.command()
def read(
    name: NameArgument,
    servo_id: IdOption,
    port: PortOption = None,
    baud: BaudOption = None,
    json: JsonOption = False,
) -> None:
    """Print one register in its unit, and as the servo counts it.

    Example: `servoloop register read --port /dev/ttyACM0 --id 3 present_voltage`
    """
    from commissioning.registers.access import read_register

    with servo_at(port, servo_id, baud) as servo:
        value = read_register(servo, name)
    if json:
        print_json(value)
    else:
        typer.echo(_text(value))


@app.command(context_settings={"ignore_unknown_options": True})  # such as the value -300
def write(
    name: NameArgument,
    value: Annotated[str, typer.Argument(help="As the servo counts (120), or a quantity with its unit (12.0V).")],
    servo_id: IdOption,
    port: PortOption = None,
    baud: BaudOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Write one register and read it back. EEPROM only where it differs, under its lock.

    Goals are refused, and under torque everything but the torque switch. That asks first: switched on, the servo is
    held where it stands, and stays so; switched off, what it held falls.
    Example: `servoloop register write --port /dev/ttyACM0 --id 3 max_temperature 65C`
    """
    from commissioning.registers.access import value_to_write, write_register

    switch = name == "torque_enable"
    with servo_at(port, servo_id, baud) as servo:
        if switch:
            on = value_to_write(servo, name, value)
            does = "holds where it stands, under torque" if on else "lets go, and what it holds falls"
            confirm(f"servo {servo_id} {does}: go on?", yes)
        written = write_register(servo, name, value, torque=switch)
    if json:
        print_json(written)
    elif written.changed:
        typer.echo(f"servo {servo_id}: {_text(written.after)}, before {written.before.text}")
    else:
        typer.echo(f"servo {servo_id}: {_text(written.after)} already: nothing written")


def _text(value: "RegisterValue") -> str:
    raw = f" (raw {value.raw})" if value.unit else ""
    return f"{value.name} {value.text}{raw}"
