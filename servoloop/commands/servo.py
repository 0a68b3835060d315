"""Commands for one servo: set its ID and baud rate, reset it, reboot it, and read and write its registers."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.commands.registers import (
    ModelOption,
    RegisterAddress,
    name_and_value,
    name_to_read,
    print_address,
    tables,
    whole_number,
    write_at,
    write_status_level,
)
from servoloop.commands.shared.console import JsonOption, YesOption, confirm, print_json, text_console
from servoloop.commands.shared.line_options import BaudOption, IdArgument, IdOption, PortOption, servo_at
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.stack.tables import print_table
from servoloop.stack.terminal import print_styled

if TYPE_CHECKING:
    from commissioning.registers.values import RegisterValue
    from commissioning.scan.find import FoundServo


def set_id(
    servo_id: IdArgument,
    new_id: Annotated[int, typer.Argument(min=0, max=253, help="New ID of the servo.")],
    port: PortOption = None,
    baud: BaudOption = None,
    json: JsonOption = False,
) -> None:
    """Change the ID of a servo and verify it.

    The command fails if another servo has the new ID, or if two servos share the old ID.
    Example: `servoloop set-id 1 4 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import set_id as change

    with servo_at(port, servo_id, baud) as servo:
        changed = change(servo, new_id)
    if json:
        print_json(changed)
    else:
        typer.echo(f"servo {servo_id} now has ID {new_id}, at {changed.baud} baud")


def set_baud(
    servo_id: IdArgument,
    new_baud: Annotated[int, typer.Argument(min=1, help="New baud rate of the servo.")],
    port: PortOption = None,
    baud: BaudOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Change the baud rate of a servo and check that it responds at the new rate.

    The command asks for confirmation, because the servo no longer responds at its old rate.
    Example: `servoloop set-baud 3 500000 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import set_baud as change

    with servo_at(port, servo_id, baud) as servo:
        question = f"servo {servo_id} ({servo.name}) will change from {servo.port.baud} to {new_baud} baud: continue?"
        confirm(question, yes)
        where = f" --port {port}" if port else ""
        undo = f"To undo this change, run: servoloop set-baud {servo_id} {servo.port.baud}{where}"
        # The user needs this command most if the change fails halfway.
        changed = change(servo, new_baud, before_write=lambda: typer.echo(undo, err=True))
    if json:
        print_json(changed)
    else:
        typer.echo(f"servo {servo_id} responds at {changed.new_baud} baud")


def factory_reset(
    servo_id: IdArgument,
    port: PortOption = None,
    baud: BaudOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Reset a servo to its factory settings and list the settings that changed.

    The command asks for confirmation. The servo keeps its ID, except that a Dynamixel servo with protocol 1.0 is reset
    to ID 1. The baud rate may change.
    Example: `servoloop factory-reset 3 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import factory_reset as reset

    with servo_at(port, servo_id, baud) as servo:
        question = f"servo {servo_id} ({servo.name}) will lose its settings, homing offset and limits: continue?"
        confirm(question, yes)
        report = reset(servo)
    if json:
        print_json(report)
        return
    typer.echo(f"servo {report.servo_id} responds at {report.baud} baud with its factory settings")
    for was, now in report.changes:
        typer.echo(f"  {was.name}: changed from {was.text} to {now.text}")


def reboot(
    servo_id: IdArgument,
    port: PortOption = None,
    baud: BaudOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Restart the firmware of a servo and wait until the servo responds.

    A restart disables the torque, so the command asks for confirmation if the torque is enabled.
    Example: `servoloop reboot 3 --port /dev/ttyACM0`
    """
    from commissioning.registers.address import reboot as restart
    from hal.servos.limp_arm import torque_warning

    with servo_at(port, servo_id, baud) as servo:
        held = servo.holds_torque()
        if held:
            confirm(f"{torque_warning([f'servo {servo_id}'])}. A reboot disables the torque. Continue?", yes)
        report = restart(servo, let_go=held)
    if json:
        print_json(report)
    else:
        typer.echo(f"servo {servo_id} responds again after {report.took_s:.1f} s; its torque is off")


@dataclass(frozen=True, slots=True)
class ServoAddress:
    """Port, baud rate and ID of one servo."""

    servo_id: IdOption
    port: PortOption = None
    baud: BaudOption = None

    def opened(self) -> "AbstractContextManager[FoundServo]":
        """Open the port and find the servo while the block runs. Signals can interrupt the block."""
        return servo_at(self.port, self.servo_id, self.baud)


NameArgument = Annotated[str | None, typer.Argument(help="Name of the register, such as present_voltage.")]
app = typer.Typer(no_args_is_help=True, help="Read and write the registers of one servo, by name and with units.")
app.command()(tables)


@app.command("list")
@grouped_options
def list_registers(address: ServoAddress, json: JsonOption = False) -> None:
    """List all registers of a servo with their current values.

    Example: `servoloop register list --port /dev/ttyACM0 --id 3`
    """
    from rich.table import Table

    from commissioning.registers.access import list_registers as read_all

    with address.opened() as servo:
        values = read_all(servo)
    if json:
        print_json(values)
        return
    table = Table(
        "register", "address", "access", "memory", "value", "raw", title=f"servo {address.servo_id}: {servo.name}"
    )
    for one in values:
        access, kept = "read, write" if one.writable else "read", "EEPROM" if one.persistent else "RAM"
        table.add_row(one.name, str(one.address), access, kept, one.text, "" if one.raw is None else str(one.raw))
    print_table(text_console(), table, "register", "value")


@app.command()
@grouped_options
def read(
    *,
    name: NameArgument = None,
    at: ServoAddress,
    register: RegisterAddress,
    json: JsonOption = False,
) -> None:
    """Print the value of one register, both in its unit and as the raw number.

    On a model without a control table, registers have no names. Read such a register with --address and --size.
    Example: `servoloop register read --port /dev/ttyACM0 --id 3 present_voltage`
    """
    from commissioning.registers.access import read_register

    span = register.span()
    name = name_to_read(name, span)
    with at.opened() as servo:
        if span:
            print_address(servo, span, json)
            return
        value = read_register(servo, name)
    if json:
        print_json(value)
    else:
        typer.echo(_text(value))


@app.command(context_settings={"ignore_unknown_options": True})  # such as the value -300
@grouped_options
def write(
    *,
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="[NAME] VALUE",
            help="Name of the register, and its new value: a raw number (120), or a quantity with its unit (12.0V). "
            "Omit NAME if you pass --address.",
        ),
    ],
    at: ServoAddress,
    register: RegisterAddress,
    model: ModelOption = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Write one register and verify it.

    EEPROM registers are written only if the value differs, and the EEPROM is locked again afterwards. Goal registers
    are rejected. While torque is enabled, only torque_enable can be written, and only after confirmation. When its
    torque is enabled, a servo holds its current position. When its torque is disabled, a servo drops its load. With
    --address and --size, a register without a name is written after confirmation and without these checks. With
    --model, the status level of a servo that responds only to pings is written.
    Example: `servoloop register write --port /dev/ttyACM0 --id 3 max_temperature 65C`
    """
    from commissioning.registers.access import value_to_write, weak_torque, write_register

    if model is not None:
        write_status_level(at.port, at.servo_id, at.baud, model, words)
        return
    span = register.span()
    name, value = name_and_value(words, span)
    number = whole_number(value) if span else 0
    switch = name == "torque_enable"
    with at.opened() as servo:
        if span:
            write_at(servo, span, number, yes, json)
            return
        if switch:
            on = value_to_write(servo, name, value)
            if on and (warning := weak_torque(servo)):
                print_styled(f"Warning: {warning}", fg="yellow", err=True)
            effect = "will hold its position with torque enabled" if on else "will disable its torque and drop its load"
            confirm(f"servo {at.servo_id} {effect}: continue?", yes)
        written = write_register(servo, name, value, torque=switch)
    if json:
        print_json(written)
    elif written.changed:
        typer.echo(f"servo {at.servo_id}: {_text(written.after)}, previously {written.before.text}")
    else:
        typer.echo(f"servo {at.servo_id}: {_text(written.after)}; nothing was written because the value is the same")


def _text(value: "RegisterValue") -> str:
    raw = f" (raw {value.raw})" if value.unit else ""
    return f"{value.name} {value.text}{raw}"
