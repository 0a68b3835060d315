"""``servoloop up``: the stack of one arm under ROS 2."""

import logging
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivers.errors import DriverError
from nodes.ros_environment import require_ros
from servoloop.commands.options import (
    BACKLASH_DEG,
    ArmOption,
    BacklashOption,
    NetworkOption,
    RobotOption,
    SeedOption,
    UrdfOption,
    set_network,
)
from servoloop.dashboard.browser import require_view
from servoloop.recording.mcap import RecordOption, check_path
from servoloop.stack.arm_folders import OWN, find_arm, read_arm_files
from servoloop.stack.devices import parse_ports
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.processes import Interrupted
from servoloop.stack.robot_files import make_folder, require_writable
from servoloop.stack.terminal import log_to_terminal

if TYPE_CHECKING:
    from servoloop.simulation.real_clients import SimulatedTime


LOG = logging.getLogger("servoloop")


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
    from servoloop.up import UpOptions
    from servoloop.up import up as run

    log_to_terminal()
    set_network(network)
    if ready_file is not None:
        if ready_file.is_dir():
            raise DriverError(f"--ready-file {ready_file} is a folder: choose the name of a file")
        require_writable(ready_file.parent)
    if record is not None:
        check_path(record)
    options = UpOptions(keep_alive, publish_transforms, _simulated_time(rtf, step), record)
    files = read_arm_files(find_arm(arm), urdf, controllers, robot)
    if not spawn:
        files = replace(files, controllers=replace(files.controllers, controllers=()))
    devices = parse_ports(port or [], files.robot.file.lines())

    def ready(what: str) -> None:
        typer.echo(f"ready: {what}")
        if ready_file is not None:
            write_ready(ready_file)

    raise typer.Exit(run(hardware, devices, files, ready, options))


def write_ready(path: Path) -> None:
    """Write the file, whole or not at all. An arm that is up stays so where that fails: it is logged."""
    partial = path.with_name(path.name + ".part")
    try:
        partial.write_text(f"{os.getpid()}\n")
        partial.replace(path)
    except OSError as error:
        LOG.warning("cannot write %s: %s", path, error.strerror or error)
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def _simulated_time(rtf: str | None, step: bool) -> "SimulatedTime | None":
    """Simulated time as ``--rtf`` and ``--step`` ask for it; None for the machine's own."""
    if rtf is None and not step:
        return None
    from servoloop.simulation.pace import Pace, parse_factor
    from servoloop.simulation.real_clients import SimulatedTime
    from sim_backend.buses.build import Build

    return SimulatedTime(Pace(parse_factor("max" if rtf is None else rtf), paused=step), Build(BACKLASH_DEG))


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
    from servoloop.stack.signals import Signals

    set_network(network)
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


def demo(
    grades: Annotated[str, typer.Option(help="Grades to pick, separated by commas.")] = "A,B,C",
    repeat: Annotated[int, typer.Option(min=1, help="How often to go through them.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out/demo"),
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    backlash_deg: BacklashOption = BACKLASH_DEG,
    seed: SeedOption = None,
    record: RecordOption = None,
    view: Annotated[bool, typer.Option("--view", help="Show the arm in a browser meanwhile.")] = False,
) -> None:
    """Pick and place on virtual servos: show it live, measure it, exit with 0 if all cubes are right.

    With all grades two more cubes are sorted for comparison, one without gravity compensation and one without lead.
    Example: `servoloop demo --grades A,C --repeat 3`
    """
    from rich.console import Console

    from servoloop.demo import demo as reports
    from servoloop.demo.cell import CellOptions, check_grades
    from servoloop.demo.demo import demo as run
    from servoloop.demo.jobs import Live
    from sim_backend.buses.build import Build

    jobs = [grade for grade in grades.split(",") if grade.strip()]
    if not jobs:
        raise DriverError(f"--grades takes grades such as A,B,C, not {grades!r}")
    if record is not None:
        check_path(record)
    chosen = find_arm(arm)
    check_grades(jobs, chosen)
    require_ros()
    if view:
        require_view()
    make_folder(out)
    console = Console()
    with Live(console) as live:
        options = CellOptions(out, chosen, robot, Build(backlash_deg, seed), record, view)
        report = run(jobs, repeat, options, live)
    reports.print_table(report, console)
    reports.write_json(report, out / "result.json")
    raise typer.Exit(0 if reports.succeeded(report) else 1)
