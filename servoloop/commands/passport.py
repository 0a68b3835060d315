"""``servoloop passport``: save the EEPROM of all servos to a file, compare it with the servos, and restore it."""

import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from commissioning.atomic_write import require_file
from commissioning.commissioning_errors import LARGEST_BAUD, SMALLEST_BAUD
from commissioning.passport.compare import Comparison, compare, take_passport
from commissioning.passport.file import Passport, PassportError, read_passport, write_passport
from commissioning.passport.restore import Restoration, plan_replacement, plan_restore, restore_all
from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.eeprom import Change
from drivers.servos.catalog import MODELS
from hal.robot_file.robot_file import RobotFile, load_robot_file
from servoloop.commands.shared.console import JsonOption, YesOption, confirm, print_json, text_console
from servoloop.commands.shared.line_options import (
    PortOption,
    adapter_serial,
    bus_of,
    device_of,
    interruptible,
    open_line,
)
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.arm_options import RobotOption
from servoloop.stack.tables import print_table

app = typer.Typer(no_args_is_help=True, help="Save, compare and restore the EEPROM of all servos.")

USUAL_BAUD = 1_000_000
SAME = "All servos match the passport."


@dataclass(frozen=True, slots=True)
class PassportPlace:
    """Passport file, and the bus with the servos that it describes."""

    file: Annotated[
        Path | None,
        typer.Argument(help="Passport file (default: SERIAL.passport.yaml, with the adapter's serial number)."),
    ] = None
    port: PortOption = None
    arm: Annotated[
        str | None, typer.Option(help="Arm with the servos: a name that `servoloop arms` lists, or an arm folder.")
    ] = None
    robot: RobotOption = None
    bus: Annotated[str | None, typer.Option(help="Bus, if the robot file has several.")] = None

    def path(self) -> Path:
        """Return the path of the passport, by default named after the adapter's serial number."""
        if self.file is not None:
            return self.file
        device = self.device()
        serial = adapter_serial(device)
        if serial is None:
            raise PassportError(f"{device} has no serial number, so its passport has no default name; pass a file name")
        return Path(re.sub(r"[^A-Za-z0-9._-]", "_", serial) + ".passport.yaml")

    def device(self) -> str:
        """Return the path of the serial device. Raises CommissioningError."""
        return device_of(self.port, self.bus)

    def robot_file(self) -> RobotFile | None:
        """Return the robot file of the servos, or None if the command line does not specify a robot file."""
        path = self.robot or (find_arm(self.arm).robot if self.arm else None)
        if self.bus is not None and path is None:
            raise PassportError("--bus selects a bus of a robot file; add --arm or --robot, or omit --bus")
        return load_robot_file(path) if path else None

    def baud(self, otherwise: int) -> int:
        """Return the baud rate from the robot file, or ``otherwise`` if there is no robot file."""
        robot = self.robot_file()
        return robot.lines()[bus_of(robot, self.bus)].baud if robot else otherwise


@app.command()
@grouped_options
def save(
    place: PassportPlace,
    baud: Annotated[
        int,
        typer.Option(min=SMALLEST_BAUD, max=LARGEST_BAUD, help="Baud rate if no robot file is given."),
    ] = USUAL_BAUD,
    json: JsonOption = False,
) -> None:
    """Save the EEPROM of all servos to a file.

    The command reads the servos of the robot file or, without a robot file, all STS servos that respond. The command
    does not write anything to the servos. An existing file is kept as a backup.
    Example: `servoloop passport save my_arm.passport.yaml`
    """
    path, robot_file = place.path(), place.robot_file()
    require_file(path)
    joints = robot_file.joints_on(bus_of(robot_file, place.bus)) if robot_file else {}
    models = {joint.servo_id: MODELS[joint.model] for joint in joints.values()}
    names = {joint.servo_id: name for name, joint in joints.items()}
    with open_line(place.device(), place.baud(baud), models) as line:
        taken = take_passport(line, models or None, names, adapter_serial(line.name))
    write_passport(path, taken)
    if json:
        print_json({"written": str(path), **taken.model_dump()})
    else:
        servos = ", ".join(map(str, taken.servos))
        typer.echo(f"{path}: saved the EEPROM of servos {servos}, adapter {taken.adapter or 'without a serial number'}")


@app.command()
@grouped_options
def diff(
    place: PassportPlace,
    json: JsonOption = False,
) -> None:
    """Show the registers whose values differ from the passport.

    The exit status is 1 if there are differences. Example: `servoloop passport diff my_arm.passport.yaml`
    """
    passport = read_passport(place.path())
    with _line_of(passport, place) as line:
        found, adapter = compare(line, passport), adapter_serial(line.name)
    if json:
        print_json({**asdict(found), "same": found.same, "adapter": adapter})
    else:
        _print_comparison(found, passport, adapter)
    raise typer.Exit(0 if found.same else 1)


@app.command("restore")
@grouped_options
def restore_(
    place: PassportPlace,
    servo_id: Annotated[int | None, typer.Option("--id", help="Restore only this servo from the passport.")] = None,
    to_new: Annotated[
        bool, typer.Option("--to-new", help="Write the saved data of --id to a new servo. Connect only the new servo.")
    ] = False,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Write the passport's values to all registers that differ, after you have confirmed the changes.

    Servos with torque enabled are rejected. Each register is read back. The EEPROM is then locked, and the servo is
    rebooted. Example, after replacing the gripper's servo:
    `servoloop passport restore my_arm.passport.yaml --id 6 --to-new`
    """
    if to_new and servo_id is None:
        raise PassportError("--to-new requires --id: the ID of the servo that the new servo replaces")
    if json and not yes:
        raise PassportError("--json cannot ask for confirmation; add --yes")
    passport = read_passport(place.path())
    with interruptible(), _line_of(passport, place) as line:
        _warn_of_other_adapter(passport, adapter_serial(line.name))
        if to_new and servo_id is not None:
            found = [plan_replacement(line, passport, servo_id)]
        else:
            found = plan_restore(line, passport, servo_id)
        plans = [plan for plan in found if plan.values]
        if plans and not yes:
            print_table(text_console(), _planned(plans), "register")
            confirm("Write this?", yes)
        changes = restore_all(line, MonotonicClock(), plans)
    _print_changes(changes, json)


def _line_of(passport: Passport, place: PassportPlace) -> AbstractContextManager[Bus]:
    models = {servo_id: servo.servo_model for servo_id, servo in passport.servos.items()}
    return open_line(place.device(), place.baud(passport.baud), models)


def _warn_of_other_adapter(passport: Passport, adapter: str | None) -> None:
    """Warn if the passport was saved with another adapter, and may therefore belong to another arm."""
    if passport.adapter != adapter:
        names = [one or "without a serial number" for one in (passport.adapter, adapter)]
        message = f"the passport was saved with the adapter {names[0]}, but this is the adapter {names[1]}"
        typer.echo(message, err=True)


def _print_comparison(found: Comparison, passport: Passport, adapter: str | None) -> None:
    _warn_of_other_adapter(passport, adapter)
    table = Table("servo", "joint", "register", "passport", "now")
    for one in found.differences:
        joint = passport.servos[one.servo_id].joint or ""
        table.add_row(str(one.servo_id), joint, one.register, str(one.saved), str(one.now))
    if found.differences:
        print_table(text_console(), table, "joint", "register")
    for servo_id in found.absent:
        typer.echo(f"servo {servo_id} does not respond")
    for servo_id in found.others:
        typer.echo(f"servo {servo_id} responds, but it is not in the passport")
    if found.same:
        typer.echo(SAME)


def _planned(plans: Sequence[Restoration]) -> Table:
    table = Table("servo", "register", "now", "new")
    for plan in plans:
        for register, value in plan.values.items():
            table.add_row(str(plan.servo_id), register.name, str(plan.now[register.name]), str(value))
    return table


def _print_changes(changes: dict[int, tuple[Change, ...]], json: bool) -> None:
    written = [
        {"servo_id": servo_id, "register": change.register.name, "old": change.old, "new": change.new}
        for servo_id, made in changes.items()
        for change in made
    ]
    if json:
        print_json(written)
        return
    for one in written:
        typer.echo(f"servo {one['servo_id']}: {one['register']} changed from {one['old']} to {one['new']}")
    typer.echo("The EEPROMs are locked, and the servos were restarted and checked." if written else SAME)
