"""``servoloop setup``: assign an arm's IDs and settings to factory-new servos, one servo after another."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivers.driver_errors import DriverError
from servoloop.commands.shared.console import JsonOption, Keyboard, print_json, text_console
from servoloop.commands.shared.line_options import PortOption, bus_of, device_of, open_line
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import known_arm
from servoloop.stack.arm_options import ServoArm
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals
from servoloop.stack.tables import print_table
from servoloop.stack.terminal import print_styled

if TYPE_CHECKING:
    from commissioning.set_up.flow import Audit, SetUp, SetUpTask


@grouped_options
def setup(
    *,
    port: PortOption = None,
    arm: ServoArm,
    bus: Annotated[str | None, typer.Option("--bus", help="Bus, if the robot file has several.")] = None,
    turn: Annotated[
        bool, typer.Option("--turn", help="Turn the horn of each loose servo slightly, to detect a wrong gear ratio.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Set the IDs and settings of new servos, one servo after another.

    The command asks you to connect one servo at a time and takes the settings from the robot file. Only registers that
    differ are written; they are read back and locked. Servos with torque enabled are refused. The torque does not
    change, except that --turn enables it briefly. You can run the command again at any time; it recognizes the servos
    that are already set up.
    Example: `servoloop setup --arm so101 --port /dev/ttyACM0`
    """
    from commissioning.set_up.flow import SetUp
    from commissioning.set_up.only_one import places_of
    from drivers.clock import MonotonicClock

    file = known_arm(arm).file
    name = bus_of(file, bus)
    places = places_of(file, name)
    models = {place.servo_id: place.model for place in places}
    left = "a servo that was turned may still have torque enabled" if turn else ""
    with Signals(left) as signals, open_line(device_of(port, bus), file.lines()[name].baud, models) as line:
        plugger = Plugger(signals)
        made = SetUp(line, MonotonicClock(), places, plugger, turn=turn, stopped=lambda: signals.count > 0)
        rows = _run(made)
    if json:
        print_json([_plain(row) for row in rows])
    else:
        _print(rows)


class Plugger:
    """Dialog with the person who connects the servos.

    The dialog uses stderr, so that stdout contains only the result.
    """

    def __init__(self, signals: Signals) -> None:
        self._keyboard = Keyboard(signals)

    def say(self, text: str) -> None:
        """Print a line."""
        typer.echo(text, err=True)

    def connect(self, task: "SetUpTask") -> None:
        """Print any problem with the connected servos and the next task, and wait for Enter."""
        if task.problem:
            print_styled(task.problem, fg="yellow", err=True)
        print_styled(f"{task.text}, then press Enter", bold=True, err=True)
        self._keyboard.next_line()


def _run(made: "SetUp") -> "list[Audit]":
    """Run the setup. Error messages state which servos are done and how to continue."""
    from commissioning.slow_arm import StoppedError

    try:
        return made.run()
    except (DriverError, Interrupted) as error:
        done = f"set up so far: {', '.join(made.done)}" if made.done else "no servo is set up yet"
        interrupted = isinstance(error, Interrupted | StoppedError)
        left = made.torque_left or "the torque of the servos is unchanged"
        noted = not interrupted and left in getattr(error, "__notes__", ())
        torque = "" if noted else f"{left[0].upper()}{left[1:]}. "
        state = f"{done}. {torque}Run the same command again to continue"
        if interrupted:
            why = "interrupted" if isinstance(error, StoppedError) else error
            raise Interrupted(f"{why}; {state}") from None
        error.add_note(state)
        raise


def _plain(row: "Audit") -> dict[str, Any]:
    changes = [{"register": one.register.name, "old": one.old, "new": one.new} for one in row.changes]
    return {
        **{"joint": row.joint, "servo_id": row.servo_id, "model": row.model, "voltage_v": round(row.voltage_v, 1)},
        **{"from_id": row.from_id, "from_baud": row.from_baud, "changes": changes},
        "gear": row.gear and asdict(row.gear),
    }


def _print(rows: "list[Audit]") -> None:
    from rich.table import Table

    table = Table("joint", "servo", "model", "V", "before", "gear", "written")
    table.title = "All servos respond, have these settings and are locked."
    for row in rows:
        was = "" if row.from_id is None else f"ID {row.from_id}"
        was += f", {row.from_baud} baud" if row.from_baud else ""
        gear = row.gear.verdict if row.gear else ""
        written = ", ".join(f"{one.register.name} {one.old} to {one.new}" for one in row.changes)
        table.add_row(row.joint, str(row.servo_id), row.model, f"{row.voltage_v:.1f}", was, gear, written or "nothing")
    print_table(text_console(), table, "joint", "model", "before", "gear", "written")
