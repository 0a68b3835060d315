"""``servoloop tune``: measure how well a joint follows its commands, and propose better servo gains."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from commissioning.atomic_write import write_file
from drivers.driver_errors import DriverError
from servoloop.commands.shared.console import JsonOption, YesOption, confirm, print_json, text_console
from servoloop.commands.shared.line_options import PortsOption, require_ports, served_devices
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.extras import missing_extras
from servoloop.stack.arm_options import ServoArm

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import Console

    from commissioning.tune.report import TuneReport
    from commissioning.tune.tuner import OpenBuses, Tuner
    from drivers.bus.bus import Bus
    from drivers.clock import Clock
    from drivers.servos.register import ServoModel
    from hal.joint import Joint
    from hal.robot_file.robot_file import RobotFile
    from servoloop.stack.robot_files import ServoFiles
    from servoloop.stack.signals import Signals

FOLDER: Final = Path("out") / "tune"


@dataclass(frozen=True, slots=True)
class TuneRequest:
    """Joint to measure, the joint's position, and the gains to write before the second measurement."""

    joint: Annotated[str, typer.Argument(help="Joint to measure.")]
    more: Annotated[list[str] | None, typer.Argument(metavar="GAIN=VALUE", help="Further gains for --write.")] = None
    at: Annotated[
        float | None,
        typer.Option(help="Position for the measurement, in rad or m (default: near the current position)."),
    ] = None
    write: Annotated[
        list[str] | None, typer.Option("--write", help="Gains to write before measuring again: --write P=24 D=32.")
    ] = None
    apply: Annotated[bool, typer.Option("--apply", help="Write the proposed gains and measure again.")] = False

    def require_consistent(self) -> None:
        """Raise TuneError if the options contradict each other."""
        from commissioning.tune.gains import TuneError

        if self.more and not self.write:
            more = " ".join(self.more)
            raise TuneError(f"{more}: gains need the option --write, as in --write {more}")
        if self.write and self.apply:
            raise TuneError("--apply writes the proposed gains and --write writes yours; use only one of them")

    def gains(self, model: "ServoModel") -> "Mapping[str, int]":
        """Return the gains to write, keyed by name. Raises TuneError if the servo does not have one of these gains."""
        from commissioning.tune.gains import parse_gains

        return parse_gains(model, [*self.write, *(self.more or ())]) if self.write else {}


@grouped_options
def tune(
    *,
    port: PortsOption = None,
    arm: ServoArm,
    request: TuneRequest,
    out: Annotated[Path | None, typer.Option(help="SVG file to write (default: out/tune/JOINT.svg).")] = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Measure how well a joint follows steps and a sine wave, and propose gains for its servo.

    The command asks for confirmation before the arm moves. The command reports overshoot, settling time, delay, sag,
    following error and oscillation. Gains are written only with --write or --apply. The command then measures again and
    shows both results side by side. Stop the stack first, because the command opens the port itself.
    Example: `servoloop tune elbow_flex --arm so101 --port /dev/ttyACM0`, then with `--write P=24 D=32`
    """

    from commissioning.atomic_write import make_folder, require_file
    from commissioning.slow_arm import ENDED_EARLY
    from servoloop.stack.signals import Signals

    request.require_consistent()
    files = arm.read()
    path = out or FOLDER / f"{request.joint}.svg"
    make_folder(path.parent)
    require_file(path, ".svg")
    signals = Signals(ENDED_EARLY)
    with served_devices(port, files) as devices:
        tuner, ending = _tuner(files, request.joint, devices, signals)
        gains = request.gains(tuner.joint.model)
        if not yes:
            require_ports(devices, files.robot.file)
        confirm(_question(tuner, request, gains, ending.announced), yes)
        with signals:
            report = _tuned(tuner, request, gains, signals)
            typer.echo(ending.reached, err=True)
    if not json:
        print_report(report, files.robot_path, text_console())
    drawn, failed = None, None
    try:
        drawn = _drawn(path, report)
    except DriverError as error:
        failed = error
    if json:
        print_json({**report.as_dict(), "picture": None if drawn is None else str(drawn)})
    elif drawn is not None:
        text_console().print(f"Plot: {drawn}", highlight=False, soft_wrap=True)
    if failed is not None:
        raise failed


@dataclass(frozen=True, slots=True)
class _EndingText:
    """Texts about the final state of the arm: an announcement before the measurement and a report after it."""

    announced: str
    reached: str


def _tuner(
    files: "ServoFiles", joint: str, devices: "Mapping[str, str]", signals: "Signals"
) -> "tuple[Tuner, _EndingText]":
    """Return the tuner of a joint and the texts about the arm's final state."""
    from commissioning.tune.tuner import Ending, Tuner
    from drivers.clock import MonotonicClock
    from servoloop.stack.devices import world_feed

    file, clock = files.robot.file, MonotonicClock()
    relax = file.on_exit.releases(virtual=world_feed(devices) is not None)
    park = file.park.pose if file.park else None
    opened = _opener(file, devices, clock)
    ending = Ending(relax, park)
    tuner = Tuner(files.robot.joints, joint, opened, clock, ending, signals=lambda: signals.count)
    return tuner, _ending_text(relax, park is not None)


def _ending_text(relax: bool, park: bool) -> _EndingText:
    if not relax:
        return _EndingText(
            "At the end the arm holds its initial position.",
            "the arm holds its position with torque enabled (on_exit: hold)",
        )
    where = "moves to its park pose" if park else "returns to its initial position"
    left = "in its park pose" if park else "at its initial position"
    return _EndingText(
        f"At the end the arm {where} and its torque is disabled.", f"the arm is {left}, and its torque is off"
    )


def _opener(file: "RobotFile", devices: "Mapping[str, str]", clock: "Clock") -> "OpenBuses":
    """Return a function that opens all buses, for joints whose P gains may differ from those in the robot file."""
    from servoloop.stack.hardware import open_buses

    def opened(joints: "Sequence[Joint]") -> "Mapping[str, Bus]":
        own = {one.name: file.joints[one.name].model_copy(update={"position_p": one.position_p}) for one in joints}
        return open_buses(file.model_copy(update={"joints": own}), devices, clock)

    return opened


def _question(tuner: "Tuner", request: TuneRequest, gains: "Mapping[str, int]", end: str) -> str:
    """Return the question that describes all motions and register writes.

    Raises TuneError if a motion or a write is impossible.
    """
    from commissioning.tune.trial import plan_for, plan_question

    writes = bool(gains or request.apply)
    tuner.check_write(writes)
    others = [joint.name for joint in tuner.joints if joint.name != tuner.joint.name]
    end = " ".join(filter(None, (end, tuner.releases(writes))))
    text = plan_question(tuner.joint, plan_for(tuner.joint, tuner.position, request.at), others, end)
    if not writes:
        return text
    wanted = " ".join(f"{name}={value}" for name, value in gains.items()) or "The proposed gains"
    return (
        f"{wanted} will be written to servo {tuner.joint.servo_id} after the first measurement. Before the write, "
        "the torque of the arm is disabled (in the park pose, if the arm has one). Then the measurement is repeated. "
        f"First: {text}"
    )


def _tuned(tuner: "Tuner", request: TuneRequest, gains: "Mapping[str, int]", signals: "Signals") -> "TuneReport":
    from commissioning.commissioning_errors import text_with_notes
    from commissioning.slow_arm import StoppedError
    from commissioning.tune.report import tune as run
    from servoloop.stack.processes import Interrupted

    try:
        return run(tuner, request.at, gains, request.apply)
    except StoppedError as error:
        if signals.count:
            raise Interrupted(text_with_notes(error)) from None
        raise


def _drawn(path: Path, report: "TuneReport") -> Path | None:
    """Draw the plot and return its path, or None without the ``report`` extra.

    Raises DriverError if the plot cannot be written.
    """
    if sentence := missing_extras("the plot", "report"):
        typer.echo(f"servoloop: {sentence}", err=True)
        return None
    from servoloop.commands.output.tune_picture import picture

    write_file(path, picture(report), keep=False)
    return path


def print_report(report: "TuneReport", robot_file: Path, console: "Console") -> None:
    """Print the results, the proposed gains and instructions for keeping the gains."""
    from servoloop.commands.output.tune_output import table, words

    console.print(table(report))
    for line in words(report, robot_file):
        console.print(line, highlight=False, soft_wrap=True)
