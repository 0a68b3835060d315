"""Verbs for one servo: its ID and rate, factory reset and reboot."""

from typing import Annotated

import typer

from servoloop.verbs.line import BaudOption, IdArgument, PortOption, servo_at
from servoloop.verbs.output import JsonOption, YesOption, confirm, print_json


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
    from commissioning.registers.reset import factory_reset as reset

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
    from commissioning.registers.reset import reboot as restart
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
