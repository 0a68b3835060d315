"""Verbs for one servo: its ID and rate, factory reset and reboot."""

from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.commands.console import JsonOption, YesOption, confirm, print_json, print_table
from servoloop.commands.line_options import BaudOption, IdArgument, IdOption, PortOption, servo_at

if TYPE_CHECKING:
    from commissioning.registers.values import RegisterValue


def set_id(
    servo_id: IdArgument,
    new_id: Annotated[int, typer.Argument(min=0, max=253, help="The ID that it gets.")],
    port: PortOption = None,
    baud: BaudOption = None,
    json: JsonOption = False,
) -> None:
    """Give a servo another ID, read back. Refused where another servo has it, or two have the old one.

    Example: `servoloop set-id 1 4 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import set_id as change

    with servo_at(port, servo_id, baud) as servo:
        changed = change(servo, new_id)
    if json:
        print_json(changed)
    else:
        typer.echo(f"servo {servo_id} is {new_id} now, at {changed.baud} baud")


def set_baud(
    servo_id: IdArgument,
    new_baud: Annotated[int, typer.Argument(min=1, help="The rate that it gets.")],
    port: PortOption = None,
    baud: BaudOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Give a servo another baud rate; it is looked for there. Asks first, for at its old rate it is silent then.

    Example: `servoloop set-baud 3 500000 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import set_baud as change

    with servo_at(port, servo_id, baud) as servo:
        confirm(f"servo {servo_id} ({servo.name}) goes from {servo.port.baud} to {new_baud} baud: go on?", yes)
        changed = change(servo, new_baud)
    if json:
        print_json(changed)
        return
    typer.echo(f"servo {servo_id} answers at {changed.new_baud} baud")
    if changed.old_baud != changed.new_baud:
        where = f" --port {port}" if port else ""
        typer.echo(f"back: servoloop set-baud {servo_id} {changed.old_baud}{where}")


def factory_reset(
    servo_id: IdArgument,
    port: PortOption = None,
    baud: BaudOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Give a servo its factory's settings, and say which it has lost. Asks first.

    It keeps its ID, but for Dynamixels of protocol 1.0, which get 1; the rate may change.
    Example: `servoloop factory-reset 3 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import factory_reset as reset

    with servo_at(port, servo_id, baud) as servo:
        confirm(f"servo {servo_id} ({servo.name}) loses its settings, homing offset and limits too: go on?", yes)
        report = reset(servo)
    if json:
        print_json(report)
        return
    typer.echo(f"servo {report.servo_id} answers at {report.baud} baud with its factory's settings")
    for was, now in report.changes:
        typer.echo(f"  {was.name}: {was.text}, now {now.text}")


def reboot(
    servo_id: IdArgument,
    port: PortOption = None,
    baud: BaudOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Restart a servo's firmware and wait until it answers. Asks first where it holds torque, for it lets go.

    Example: `servoloop reboot 3 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import reboot as restart
    from hal.servos.limp_arm import torque_warning

    with servo_at(port, servo_id, baud) as servo:
        held = servo.holds_torque()
        if held:
            confirm(f"{torque_warning([f'servo {servo_id}'])}, which a reboot does: go on?", yes)
        report = restart(servo, let_go=held)
    if json:
        print_json(report)
    else:
        typer.echo(f"servo {servo_id} answers again after {report.took_s:.1f} s, without torque")


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
    held where it stands, and stays so; switched off, what it held torque_warning.
    Example: `servoloop register write --port /dev/ttyACM0 --id 3 max_temperature 65C`
    """
    from commissioning.registers.access import value_to_write, write_register

    switch = name == "torque_enable"
    with servo_at(port, servo_id, baud) as servo:
        if switch:
            on = value_to_write(servo, name, value)
            does = "holds where it stands, under torque" if on else "lets go, and what it holds torque_warning"
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
