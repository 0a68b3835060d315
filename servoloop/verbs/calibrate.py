"""``servoloop calibrate``: the servos' counts become the URDF's angles."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivers.errors import DriverError
from hal.errors import DescriptionError
from servoloop.verbs.line import PortOption, named_devices
from servoloop.verbs.output import JsonOption, YesOption, print_json

if TYPE_CHECKING:
    from collections.abc import Mapping

    from commissioning.calibrate.run import Outcome
    from servoloop.arms.folder import Arm
    from servoloop.files import ServoFiles

AUTO = "The arm moves by itself now, slowly, from stop to stop: clear its table, keep away. Any key stops it. Begin?"


def calibrate(
    arm: Annotated[str, typer.Option(help="The arm: a name that `servoloop arms` lists, or its folder.")],
    port: PortOption = None,
    auto: Annotated[
        bool, typer.Option("--auto", help="Nobody moves the arm: it is driven softly to its stops.")
    ] = False,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Find each joint's zero and direction, and store them beside the arm's robot file.

    Torque is off unless a sentence says that it goes on, and off at the end, whatever happens. Nothing is written
    before you have seen what was found. With --auto somebody still looks on, and says which way each joint moved.
    Example: `servoloop calibrate --arm so101 --port /dev/ttyACM0`
    """
    from commissioning.ports.adapters import only_port
    from servoloop.arms.folder import find_arm, read_arm_servos
    from servoloop.signals import Signals
    from servoloop.verbs.terminal import Terminal

    found = find_arm(arm)
    files = read_arm_servos(found)
    buses = list(files.robot.file.lines())
    if len(buses) != 1:
        raise DescriptionError(
            f"{found.robot}: an arm with several buses is calibrated bus by bus: not yet by this verb"
        )
    _require_writable(found.robot)
    (device,) = named_devices([port or only_port()], buses, arm).values()
    with Signals("servos that were under torque hold") as signals, Terminal(signals, yes) as terminal:
        outcome = _calibrated(found, files, device, terminal, auto)
    if json:
        print_json(_outcome_as_json(outcome))
    elif outcome.stored:
        former = outcome.path.with_name(outcome.path.name + ".1")
        typer.echo(f"stored in {outcome.path}{f'; the former one is {former}' if former.exists() else ''}")
    raise typer.Exit(0 if outcome.stored else 1)


def _require_writable(robot: Path) -> None:
    """Raise DriverError where no calibration could be stored: who has moved every joint is told too late."""
    from servoloop.files import require_writable

    try:
        require_writable(robot.parent)
    except DriverError as error:
        raise DriverError(f"{error}: copy the arm's folder (docs/calibrate.md) and name that with --arm") from error


def _calibrated(arm: "Arm", files: "ServoFiles", port: str, terminal: Any, auto: bool) -> "Outcome":
    from commissioning.calibrate.driven import by_itself
    from commissioning.calibrate.run import calibrate as run
    from drivers.bus.bus import Bus
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort
    from servoloop.hardware import servo_bus
    from servoloop.processes import Interrupted

    clock, plan = MonotonicClock(), arm.file.calibration
    joints = [joint.between_stops() for joint in files.robot.joints]
    baud = next(iter(files.robot.file.lines().values())).baud

    def open_bus() -> Bus:
        return servo_bus(files.robot.file, SerialPort(port, baud, clock), clock)

    if auto and not terminal.confirm(AUTO):
        raise Interrupted("nothing was moved")
    measure = by_itself(open_bus, plan, terminal, clock, terminal.stopped) if auto else None
    return run(arm.robot, joints, plan.joints, open_bus, terminal, clock, measure, terminal.stopped)


def _outcome_as_json(outcome: "Outcome") -> dict[str, Any]:
    """The outcome for programs."""
    return {
        "stored": outcome.stored,
        "file": str(outcome.path),
        "tried_under_torque": outcome.tried,
        "joints": {
            one.joint: {
                "servo_id": one.servo_id,
                "sign": one.made.sign,
                "zero_counts": one.made.zero_counts,
                "homing_offset": one.made.homing_offset,
                "lower_counts": one.made.lower_counts,
                "upper_counts": one.made.upper_counts,
                "zero_moved": one.zero_moved,
                "zero_uncertainty": one.uncertainty,
                "doubt": one.doubt or None,
            }
            for one in outcome.differences
        },
    }


def hand(
    link: Annotated[Path, typer.Argument(help="Where `servoloop emulate` serves the bus.")],
    do: Annotated[str, typer.Argument(help="hold, release, move, look, lay (the table); connect, disconnect (a box).")],
    joint: Annotated[str | None, typer.Argument(help="One joint; hold, release and connect take all without.")] = None,
    position: Annotated[float | None, typer.Argument(help="Where to move it, rad or m as the URDF counts.")] = None,
    json: JsonOption = False,
) -> None:
    """Take the virtual arm by the hand, to practise: hold joints, move one to a position, let go.

    Example: `servoloop hand ./bus hold`, `servoloop hand ./bus move elbow_flex 1.2`
    """
    from sim_backend.control import ask, control_path

    command: dict[str, Any] = {"do": do, "joints": [joint] if joint else []}
    if do == "move" and (joint is None or position is None):
        raise DriverError("move takes a joint and a position: servoloop hand ./bus move elbow_flex 1.2")
    if position is not None:
        command["position"] = position
    try:
        found = ask(control_path(link), command)
    except ValueError as error:
        raise DriverError(str(error)) from error
    if json:
        print_json(found)
        return
    if do in ("connect", "disconnect"):
        typer.echo(_connected(found))
        return
    for name, state in found.items():
        held = "held" if state["held"] else "free"
        typer.echo(f"{name:18} {state['position']:+8.4f}  {held}{'' if state['arrived'] else ', on its way'}")


def _connected(found: "Mapping[str, Mapping[str, Any]]") -> str:
    """The joints whose servos are connected, with the IDs that the servos have."""
    names = [f"{name} (ID {state['servo_id']})" for name, state in found.items() if state["connected"]]
    if not names:
        return "no servo is connected"
    every = " (the whole chain)" if len(names) == len(found) else ""
    return f"connected{every}: {', '.join(names)}"
