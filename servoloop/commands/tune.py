"""``servoloop tune``: how a joint follows with its servo's gains, and which ones would be better."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.errors import DriverError
from servoloop.commands.console import JsonOption, YesOption, confirm, print_json
from servoloop.commands.line_options import PortsOption, served_devices
from servoloop.commands.options import ArmOption, RobotOption, UrdfOption
from servoloop.extras import install_command
from servoloop.stack.arm_folders import OWN, find_arm, read_arm_servos
from servoloop.stack.robot_files import write_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import Console

    from commissioning.tune.report import Report
    from commissioning.tune.tuner import OpenBuses, Tuner
    from drivers.bus.bus import Bus
    from drivers.clock import Clock
    from hal.joint import Joint
    from hal.robot_file.robot_file import RobotFile
    from servoloop.stack.robot_files import ServoFiles
    from servoloop.stack.signals import Signals

FOLDER: Final = Path("out") / "tune"


def tune(
    joint: Annotated[str, typer.Argument(help="The joint.")],
    more: Annotated[list[str] | None, typer.Argument(metavar="GAIN=VALUE", help="More gains of --write.")] = None,
    port: PortsOption = None,
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    urdf: UrdfOption = None,
    at: Annotated[
        float | None, typer.Option(help="Where to measure, rad or m; without it a little beside where it stands.")
    ] = None,
    write: Annotated[
        list[str] | None, typer.Option("--write", help="Write these gains and measure again: --write P=24 D=32.")
    ] = None,
    apply: Annotated[bool, typer.Option("--apply", help="Write the gains it proposes, and measure again.")] = False,
    out: Annotated[Path | None, typer.Option(help="The picture, SVG; without it out/tune/JOINT.svg.")] = None,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Measure how one joint follows steps and a sine, and propose gains for its servo. It asks before it moves.

    Overshoot, settling, delay, sag, following error, and whether it shakes. Nothing is written without --write or
    --apply; then both measurements are shown side by side. No stack may run: it opens the port itself.
    Example: `servoloop tune elbow_flex --arm so101 --port /dev/ttyACM0`, then with `--write P=24 D=32`
    """
    from rich.console import Console

    from commissioning.tune.gains import parse_gains
    from servoloop.stack.loop_thread import LEFT
    from servoloop.stack.robot_files import make_folder, require_file
    from servoloop.stack.signals import Signals

    _check_words(write, more, apply)
    files = read_arm_servos(find_arm(arm), urdf, robot)
    path = out or FOLDER / f"{joint}.svg"
    make_folder(path.parent)
    require_file(path)
    signals = Signals(LEFT)
    with served_devices(port, files) as devices:
        tuner, ending = _tuner(files, joint, devices, signals)
        values = parse_gains(tuner.joint.model, [*write, *(more or ())]) if write else None
        confirm(_question(tuner, at, values, apply, ending.announced), yes)
        with signals:
            report = _tuned(tuner, at, values, apply, signals)
            typer.echo(ending.reached, err=True)
    if not json:
        print_report(report, files.robot_path, Console())
    drawn, failed = None, None
    try:
        drawn = _drawn(path, report)
    except DriverError as error:
        failed = error
    if json:
        print_json({**report.as_dict(), "picture": None if drawn is None else str(drawn)})
    elif drawn is not None:
        Console().print(f"the picture: {drawn}", highlight=False, markup=False, soft_wrap=True)
    if failed is not None:
        raise failed


def _check_words(write: list[str] | None, more: list[str] | None, apply: bool) -> None:
    from commissioning.tune.gains import TuneError

    if more and not write:
        raise TuneError(f"{' '.join(more)}: gains are written where --write says so: --write {' '.join(more)}")
    if write and apply:
        raise TuneError("--apply writes what is proposed, --write what you say: give one of them")


@dataclass(frozen=True, slots=True)
class _EndingText:
    """The state in which the arm is left, before the measurement and after it."""

    announced: str
    reached: str


def _tuner(
    files: "ServoFiles", joint: str, devices: "Mapping[str, str]", signals: "Signals"
) -> "tuple[Tuner, _EndingText]":
    """The tuner of a joint, and how it leaves the arm."""
    from commissioning.tune.tuner import Ending, Tuner
    from drivers.clock import MonotonicClock
    from servoloop.stack.devices import world_feed

    file, clock = files.robot.file, MonotonicClock()
    relax = file.on_exit.releases(virtual=world_feed(devices) is not None)
    park = file.park.pose if file.park else None
    opened = _opener(file, devices, clock)
    tuner = Tuner(
        files.robot.joints,
        joint,
        opened,
        clock,
        Ending(relax, park),
        stopped=lambda: signals.count > 0,
        hurry=lambda: signals.count > 1,
    )
    return tuner, _ending_text(relax, park is not None)


def _ending_text(relax: bool, park: bool) -> _EndingText:
    if not relax:
        return _EndingText(
            "In the end the arm holds itself where it began.", "the arm holds its position under torque (on_exit: hold)"
        )
    where = "goes to its park pose" if park else "comes back to where it began"
    left = "in its park pose" if park else "where it began"
    return _EndingText(f"In the end the arm {where} and is let go.", f"the arm is {left}, and its torque is off")


def _opener(file: "RobotFile", devices: "Mapping[str, str]", clock: "Clock") -> "OpenBuses":
    """Opens all buses for joints whose P gains may differ from the robot file's."""
    from servoloop.stack.hardware import open_buses

    def opened(joints: "Sequence[Joint]") -> "Mapping[str, Bus]":
        own = {one.name: file.joints[one.name].model_copy(update={"position_p": one.position_p}) for one in joints}
        return open_buses(file.model_copy(update={"joints": own}), devices, clock)

    return opened


def _question(tuner: "Tuner", at: float | None, values: "Mapping[str, int] | None", apply: bool, end: str) -> str:
    """Everything that is going to happen. Raises TuneError where it cannot."""
    from commissioning.tune.trial import plan_for, plan_question

    tuner.check_write(bool(values or apply))
    others = [joint.name for joint in tuner.joints if joint.name != tuner.joint.name]
    end = " ".join(filter(None, (end, tuner.releases(bool(values or apply)))))
    text = plan_question(tuner.joint, plan_for(tuner.joint, tuner.position, at), others, end)
    if not values and not apply:
        return text
    wanted = " ".join(f"{name}={value}" for name, value in (values or {}).items()) or "The proposed gains"
    return (
        f"{wanted} will be written to servo {tuner.joint.servo_id} when it has been measured: the arm is let go for "
        f"that, at its park pose where it has one, comes back, and all is done once more. First: {text}"
    )


def _tuned(
    tuner: "Tuner", at: float | None, values: "Mapping[str, int] | None", apply: bool, signals: "Signals"
) -> "Report":
    from commissioning.slow_arm import StoppedError
    from commissioning.tune.report import tune as run
    from servoloop.stack.processes import Interrupted

    try:
        return run(tuner, at, values, apply)
    except StoppedError as error:
        if signals.count:
            raise Interrupted("; ".join([str(error), *getattr(error, "__notes__", ())])) from None
        raise


def _drawn(path: Path, report: "Report") -> Path | None:
    """The picture's path; None where matplotlib is missing. Raises DriverError where it cannot be written."""
    if find_spec("matplotlib") is None:
        typer.echo(f"no picture is drawn: it needs matplotlib: {install_command('report')}", err=True)
        return None
    from servoloop.commands.tune_output import picture

    write_file(path, picture(report), keep=False)
    return path


def print_report(report: "Report", robot_file: Path, console: "Console") -> None:
    """For people: the figures, the proposal, and what to put where."""
    from servoloop.commands.tune_output import table, words

    console.print(table(report))
    for line in words(report, robot_file):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
