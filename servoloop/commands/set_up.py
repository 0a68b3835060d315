"""``servoloop setup``: from factory-new servos to those of an arm, one connected after the other."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivers.errors import DriverError, PortLost
from servoloop.commands.console import JsonOption, Keyboard, print_json, print_table
from servoloop.commands.line_options import PortOption, bus_of, open_line
from servoloop.commands.options import ArmOption, RobotOption, UrdfOption, known_arm
from servoloop.stack.arm_folders import OWN
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals
from servoloop.stack.terminal import print_styled

if TYPE_CHECKING:
    from commissioning.set_up.flow import Audit, SetUp, Task


def setup(
    port: PortOption = None,
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    urdf: UrdfOption = None,
    bus: Annotated[str | None, typer.Option("--bus", help="Which bus of a robot file that has several.")] = None,
    turn: Annotated[
        bool, typer.Option("--turn", help="Have each loose servo turn its horn a little: that tells a wrong gear.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Give new servos their IDs and the settings of the robot file, connected one after the other.

    Only what differs is written, read back and locked; nothing is written under torque, and torque stays as it is: only
    --turn switches it on, and off again. Run it again at any time: what is done is recognised.
    Example: `servoloop setup --arm so101 --port /dev/ttyACM0`
    """
    from commissioning.set_up.flow import SetUp
    from commissioning.set_up.only_one import places_of
    from drivers.clock import MonotonicClock

    file = known_arm(arm, urdf, robot).file
    name = bus_of(file, bus)
    places = places_of(file, name)
    models = {place.servo_id: place.model for place in places}
    left = "a servo that turned may hold torque" if turn else ""
    with Signals(left) as signals, open_line(port, file.lines()[name].baud, models) as line:
        plugger = Plugger(signals)
        made = SetUp(line, MonotonicClock(), places, plugger, turn=turn, stopped=lambda: signals.count > 0)
        rows = _run(made)
    if json:
        print_json([_plain(row) for row in rows])
    else:
        _print(rows)


class Plugger:
    """The person who plugs servos in. What is for people goes to stderr, so that stdout has the result alone."""

    def __init__(self, signals: Signals) -> None:
        self._keyboard = Keyboard(signals)

    def say(self, text: str) -> None:
        """Print a line."""
        typer.echo(text, err=True)

    def connect(self, task: "Task") -> None:
        """Print what to connect, and what was wrong with what is; wait for Enter."""
        if task.problem:
            print_styled(task.problem, fg="yellow", err=True)
        print_styled(f"{task.text}, then press Enter", bold=True, err=True)
        self._keyboard.next_line()


def _run(made: "SetUp") -> "list[Audit]":
    """Run it; whatever ends it says what is done, and how to go on."""
    from commissioning.slow_arm import StoppedError

    try:
        return made.run()
    except (DriverError, Interrupted) as error:
        done = f"set up so far: {', '.join(made.done)}" if made.done else "no servo is set up yet"
        torque = "" if made.turn and isinstance(error, PortLost) else "The servos' torque is as it was. "
        said = f"{done}. {torque}Run the same again: it goes on from there"
        if isinstance(error, Interrupted | StoppedError):
            why = "interrupted" if isinstance(error, StoppedError) else error
            raise Interrupted(f"{why}; {said}") from None
        error.add_note(said)
        raise


def _plain(row: "Audit") -> dict[str, Any]:
    changes = [{"register": one.register.name, "old": one.old, "new": one.new} for one in row.changes]
    return {
        **{"joint": row.joint, "servo_id": row.servo_id, "model": row.model, "voltage_v": round(row.voltage_v, 1)},
        **{"from_id": row.from_id, "from_baud": row.from_baud, "changes": changes},
        "gear": row.gear and asdict(row.gear),
    }


def _print(rows: "list[Audit]") -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("joint", "servo", "model", "V", "was", "gear", "written")
    table.title = "every servo answers, holds this, is locked"
    for row in rows:
        was = "" if row.from_id is None else f"ID {row.from_id}"
        was += f", {row.from_baud} baud" if row.from_baud else ""
        gear = row.gear.verdict if row.gear else ""
        written = ", ".join(f"{one.register.name} {one.old} to {one.new}" for one in row.changes)
        table.add_row(row.joint, str(row.servo_id), row.model, f"{row.voltage_v:.1f}", was, gear, written or "nothing")
    print_table(Console(), table, "joint", "model", "was", "gear", "written")
