"""The command line. Each verb reads its arguments and hands over."""

import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.calibrate.result import CalibrationError
from controller.manager.controllers_file import ControllersFileError
from controller.manager.plugins import PluginError
from controller.manager.registry import ClaimError
from drivers.errors import DriverError
from hal.errors import HalError
from servoloop.arms.folder import OWN, find_arm, read_arm_files
from servoloop.files import Files, make_folder, require_writable
from servoloop.hardware import HardwareKind
from servoloop.ports import device_paths, parse_ports
from servoloop.processes import Interrupted
from servoloop.recorder.record_option import RecordOption, check_path
from servoloop.ros import RosError, require_ros
from servoloop.verbs import calibration, passport, register, servo
from servoloop.verbs.arms import app as arms_app
from servoloop.verbs.calibrate import calibrate, hand
from servoloop.verbs.campaign import campaign
from servoloop.verbs.doctor import doctor
from servoloop.verbs.fault import fault
from servoloop.verbs.plot import plot
from servoloop.verbs.ports import ports
from servoloop.verbs.scan import scan
from servoloop.verbs.set_up import setup
from servoloop.verbs.simulate import simulate
from servoloop.verbs.view import view

if TYPE_CHECKING:
    from servoloop.simulation.real_clients import SimulatedTime

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="A robot arm on serial bus servos under ROS 2: real, or virtual down to the byte.",
)

bench_app = typer.Typer(no_args_is_help=True, help="Measure what is connected.")
app.add_typer(bench_app, name="bench")
app.command()(ports)
app.command()(scan)
app.command()(setup)
app.add_typer(register.register_app, name="register")
app.command()(doctor)
for verb in (servo.set_id, servo.set_baud, servo.factory_reset, servo.reboot):
    app.command()(verb)
app.command()(calibrate)
app.command()(hand)
app.command()(fault)
app.command()(simulate)
app.command()(campaign)
app.command()(plot)
app.command()(view)
app.add_typer(arms_app, name="arms")
app.add_typer(calibration.app, name="calibration")
app.add_typer(passport.app, name="passport")

BACKLASH_DEG = 1.0
"""What owners measure at the shaft of an STS3215."""
LARGEST_BAUD = 12_000_000
"""Of the fastest USB adapters."""
INTERRUPTED = 130
"""The exit status that a shell gives a program that Ctrl-C has ended."""

ArmOption = Annotated[str, typer.Option("--arm", help="The arm: a name that `servoloop arms` lists, or its folder.")]
RobotOption = Annotated[Path | None, typer.Option("--robot", help="Robot file instead of the arm's.")]
NetworkOption = Annotated[bool, typer.Option("--network", help="Not only this machine: the whole network.")]
BacklashOption = Annotated[
    float, typer.Option("--backlash", min=0.0, max=10.0, help="Degrees by which each virtual servo's shaft is free.")
]
SeedOption = Annotated[
    int | None,
    typer.Option("--seed", min=0, help="A virtual arm of its own: friction, motors, masses and supply differ by 10 %."),
]
UrdfOption = Annotated[
    Path | None, typer.Option("--urdf", help="Robot description instead of the arm's; it names the robot file.")
]


def main() -> None:
    """Run a verb. What a user can mend is said in words, without a traceback."""
    try:
        app()
    except (DriverError, HalError, ControllersFileError, ClaimError, PluginError, RosError, CalibrationError) as error:
        for text in (f"servoloop: {error}", *getattr(error, "__notes__", ())):
            typer.secho(text, fg="red", err=True)
        raise SystemExit(1) from None
    except Interrupted as error:
        typer.echo(f"servoloop: {error}", err=True)
        raise SystemExit(INTERRUPTED) from None


@app.command()
def up(
    hardware: Annotated[
        HardwareKind | None,
        typer.Option(help="What is below the loop; by default what the URDF's plugin says."),
    ] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(help="Serial device of the servos; NAME=PATH for each of several buses. Without: virtual servos."),
    ] = None,
    arm: ArmOption = OWN,
    controllers: Annotated[
        Path | None, typer.Option(help="Controllers file, as for ros2_control, instead of the arm's.")
    ] = None,
    urdf: UrdfOption = None,
    robot: RobotOption = None,
    keep_alive: Annotated[
        bool,
        typer.Option("--stay", help="Keep up when servos are lost or missing, and wait to be told to activate them."),
    ] = False,
    publish_transforms: Annotated[
        bool,
        typer.Option(
            "--robot-state-publisher/--no-robot-state-publisher",
            help="Publish robot_description and the links' transforms; not where a node of yours does.",
        ),
    ] = True,
    spawn: Annotated[
        bool,
        typer.Option(
            "--spawn/--no-spawn",
            help="Load and activate the file's controllers; not where ros2_control's spawner does.",
        ),
    ] = True,
    rtf: Annotated[
        str | None,
        typer.Option(
            metavar="FACTOR", help="Simulated time, FACTOR times as fast as real time; `max`: as fast as it goes."
        ),
    ] = None,
    step: Annotated[
        bool, typer.Option("--step", help="Simulated time that only the service step_simulation advances.")
    ] = False,
    record: RecordOption = None,
    network: NetworkOption = False,
    ready_file: Annotated[Path | None, typer.Option(help="Written when the stack is ready for goals.")] = None,
) -> None:
    """Bring the arm up under ROS 2 and keep it up until Ctrl-C.

    Example: `servoloop up --port /dev/ttyACM0`, with two buses `servoloop up --port arm=/dev/ttyACM0
    --port hand=/dev/ttyUSB0`, virtual servos five times as fast as real ones `servoloop up --rtf 5`
    """
    from servoloop.up import up as run

    _log_to_terminal()
    _set_network(network)
    if ready_file is not None:
        if ready_file.is_dir():
            raise DriverError(f"--ready-file {ready_file} is a folder: name a file")
        require_writable(ready_file.parent)
    if record is not None:
        check_path(record)
    simulated = _simulated_time(rtf, step)
    files = read_arm_files(find_arm(arm), urdf, controllers, robot)
    if not spawn:
        files = replace(files, controllers=replace(files.controllers, controllers=()))
    devices = parse_ports(port or [], files.robot.file.lines())

    def ready(what: str) -> None:
        typer.echo(f"ready: {what}")
        if ready_file is not None:
            partial = ready_file.with_name(ready_file.name + ".part")
            partial.write_text(f"{os.getpid()}\n")
            partial.replace(ready_file)

    raise typer.Exit(run(hardware, devices, files, ready, keep_alive, publish_transforms, simulated, record))


@app.command()
def emulate(
    link: Annotated[Path, typer.Argument(help="Where to serve the bus: a free path. Several buses: LINK.NAME each.")],
    arm: ArmOption = OWN,
    urdf: UrdfOption = None,
    robot: RobotOption = None,
    backlash_deg: BacklashOption = BACKLASH_DEG,
    seed: SeedOption = None,
    practice: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="An arm that nobody has calibrated, by this seed, on an empty table: see `servoloop hand`.",
        ),
    ] = None,
    box: Annotated[
        bool,
        typer.Option(
            "--box",
            help="Servos as they come from the factory, all with ID 1, none connected: `servoloop hand LINK connect`.",
        ),
    ] = False,
    eeprom: Annotated[
        Path | None, typer.Option(help="File that keeps the servos' EEPROM: read if it is there, renewed as they save.")
    ] = None,
    faults: Annotated[
        Path | None,
        typer.Option(help="YAML file with what is to go wrong, in times since ready: see `servoloop fault --list`."),
    ] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder for a picture and a film of the arm at work.")] = None,
) -> None:
    """Serve the virtual servos with their world on a pseudo-terminal until Ctrl-C.

    Example: `servoloop emulate ./bus`, and then any program that takes a serial port: `./bus`
    """
    from servoloop.emulator import emulate as run
    from servoloop.realtime import claim_realtime_priority
    from servoloop.signals import Signals
    from sim_backend.build import Build
    from sim_backend.faults.script import read_script

    _log_to_terminal()
    if not link.name:
        raise DriverError(f"LINK is a free path such as ./bus, not {str(link)!r}")
    if pictures is not None:
        make_folder(pictures)
    files: Files = read_arm_files(find_arm(arm), urdf, robot=robot)
    events = read_script(faults) if faults is not None else ()
    claim_realtime_priority()
    places = " and ".join(str(path) for path in device_paths(link, files.robot.file.lines()).values())
    with Signals() as signals:
        run(
            files,
            link,
            pictures,
            Build(backlash_deg, seed, 0 if box and practice is None else practice, box),
            eeprom,
            events,
            stop=lambda: signals.count > 0,
            on_ready=lambda: typer.echo(f"ready: {len(files.robot.joints)} servos at {places}"),
        )


def _simulated_time(rtf: str | None, step: bool) -> "SimulatedTime | None":
    """Simulated time as ``--rtf`` and ``--step`` ask for it; None for the machine's own."""
    if rtf is None and not step:
        return None
    from servoloop.simulation.pace import Pace, parse_factor
    from servoloop.simulation.real_clients import SimulatedTime
    from sim_backend.build import Build

    return SimulatedTime(Pace(parse_factor("max" if rtf is None else rtf), paused=step), Build(BACKLASH_DEG))


def _set_network(network: bool) -> None:
    from nodes.discovery import open_to_network

    if network:
        open_to_network(os.environ)


def _log_to_terminal() -> None:
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")


@app.command()
def pick(
    grade: Annotated[str, typer.Argument(help="Grade of the cube: A, B or C.")],
    network: NetworkOption = False,
) -> None:
    """Send one pick-place goal, print its feedback, and exit with 0 if it succeeds.

    Example: `servoloop pick B`
    """
    if not grade.strip():
        raise DriverError("GRADE is empty, and every pick-place node refuses that: name one, such as A")
    require_ros()
    from nodes.client_node import client_node
    from nodes.pick_place.client import ACTION, PickClient
    from servoloop.signals import Signals

    _set_network(network)
    left = "the node may go on with the job"
    with Signals(left) as signals, client_node("servoloop_pick") as (node, executor):
        client = PickClient(node, executor)
        there = client.wait(5.0, lambda: signals.count > 0)
        if signals.count:
            raise Interrupted("interrupted before the job began")
        if not there:
            raise DriverError(f"nobody offers {ACTION}: start the stack and the pick-place node")
        outcome = client.pick(
            grade, lambda phase, message: typer.echo(f"{phase}: {message}"), lambda: signals.count > 0
        )
    typer.echo(("done: " if outcome.success else "failed: ") + outcome.message)
    raise typer.Exit(0 if outcome.success else 1)


@app.command()
def demo(
    grades: Annotated[str, typer.Option(help="Grades to pick, separated by commas.")] = "A,B,C",
    repeat: Annotated[int, typer.Option(min=1, help="How often to go through them.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out/demo"),
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    backlash_deg: BacklashOption = BACKLASH_DEG,
    seed: SeedOption = None,
    record: RecordOption = None,
) -> None:
    """Pick and place on virtual servos: show it live, measure it, exit with 0 if all cubes are right.

    Example: `servoloop demo --grades A,C --repeat 3`
    """
    from rich.console import Console

    from servoloop.demo import report as reports
    from servoloop.demo.cell import check_grades
    from servoloop.demo.demo import demo as run
    from servoloop.demo.live import Live
    from sim_backend.build import Build

    jobs = [grade for grade in grades.split(",") if grade.strip()]
    if not jobs:
        raise DriverError(f"--grades takes grades such as A,B,C, not {grades!r}")
    if record is not None:
        check_path(record)
    chosen = find_arm(arm)
    check_grades(jobs, chosen)
    require_ros()
    make_folder(out)
    console = Console()
    with Live(console) as live:
        report = run(jobs, repeat, out, chosen, robot, Build(backlash_deg, seed), live, record)
    reports.write_json(report, out / "result.json")
    reports.print_table(report, console)
    raise typer.Exit(0 if reports.succeeded(report) else 1)


@bench_app.command()
def bus(
    port: Annotated[str, typer.Option(help="Serial device of the servos.")],
    ids: Annotated[str, typer.Option(help="Servo IDs, such as 1-7 or 1,2,5.")] = "1-7",
    model: Annotated[str, typer.Option(help="Servo model.")] = "sts3215",
    baud: Annotated[int, typer.Option(min=1, max=LARGEST_BAUD, help="Bits per second.")] = 1_000_000,
    cycles: Annotated[int, typer.Option(min=1, help="How many cycles to measure.")] = 1000,
    hold: Annotated[
        bool, typer.Option("--hold", help="Servos without torque get it for as long as this runs.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One line of JSON instead of a table.")] = False,
) -> None:
    """Read the full state of every servo and write a goal to each, as fast as the line allows.

    Nothing moves: the goals are those that the servos hold. A goal switches a limp servo on: such are only read,
    unless --hold holds them where they stand; in the end they are limp again. Of those that get goals, goal speed
    and acceleration become 0, which is as fast as they can. Faults are counted, not fatal; it ends
    with 1 where nobody answers, where all servos have another table than the model, and where the port is lost.
    Example: `servoloop bench bus --port /dev/ttyACM0 --ids 1-7`
    """
    from rich.console import Console

    from servoloop import bench_bus

    figures = bench_bus.bench_bus(port, bench_bus.parse_ids(ids), model, baud, cycles, hold=hold)
    if json:
        typer.echo(bench_bus.as_json(figures))
    else:
        bench_bus.print_table(figures, Console())
