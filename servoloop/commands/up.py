"""``servoloop up``, ``pick`` and ``demo``: run an arm with ROS 2, send it a job, and demonstrate pick and place."""

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
from servoloop.extras import require_view
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
        typer.Option(help="Hardware that the control loop drives (default: the plugin named in the URDF)."),
    ] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(help="Serial port of the servos; NAME=PATH for each of several buses (default: virtual servos)."),
    ] = None,
    arm: ArmOption = OWN,
    controllers: Annotated[
        Path | None, typer.Option(help="Controllers file (ros2_control format) to use instead of the arm's own.")
    ] = None,
    urdf: UrdfOption = None,
    robot: RobotOption = None,
    keep_alive: Annotated[
        bool,
        typer.Option("--stay", help="Keep running if servos are missing or lost, until they are activated again."),
    ] = False,
    publish_transforms: Annotated[
        bool,
        typer.Option(
            "--robot-state-publisher/--no-robot-state-publisher",
            help="Publish robot_description and the transforms of the links, unless a node of yours does.",
        ),
    ] = True,
    spawn: Annotated[
        bool,
        typer.Option(
            "--spawn/--no-spawn",
            help="Load and activate the controllers of the file, unless ros2_control's spawner does.",
        ),
    ] = True,
    rtf: Annotated[
        str | None,
        typer.Option(metavar="FACTOR", help="Run in simulated time, FACTOR times as fast as real time, or `max`."),
    ] = None,
    step: Annotated[
        bool, typer.Option("--step", help="Run in simulated time that only the service step_simulation advances.")
    ] = False,
    record: RecordOption = None,
    network: NetworkOption = False,
    ros: Annotated[bool, typer.Option("--ros/--no-ros", help="Serve ROS 2 clients, if ROS 2 is installed.")] = True,
    ready_file: Annotated[Path | None, typer.Option(help="File to write when the stack is ready for goals.")] = None,
) -> None:
    """Run the control stack of an arm until Ctrl-C, with or without ROS 2.

    Example: `servoloop up --port /dev/ttyACM0`; with two buses,
    `servoloop up --port arm=/dev/ttyACM0 --port hand=/dev/ttyUSB0`; with virtual servos at five times real time,
    `servoloop up --rtf 5`
    """
    from servoloop.up import UpOptions
    from servoloop.up import up as run

    log_to_terminal()
    set_network(network)
    if ready_file is not None:
        if ready_file.is_dir():
            raise DriverError(f"--ready-file {ready_file} is a folder; choose a file")
        require_writable(ready_file.parent)
    if record is not None:
        check_path(record)
    options = UpOptions(keep_alive, publish_transforms, _simulated_time(rtf, step), record, ros)
    files = read_arm_files(find_arm(arm), urdf, controllers, robot)
    if not spawn:
        files = replace(files, controllers=replace(files.controllers, controllers=()))
    devices = parse_ports(port or [], files.robot.file.lines())

    def ready(text: str) -> None:
        typer.echo(f"ready: {text}")
        if ready_file is not None:
            write_ready(ready_file)

    raise typer.Exit(run(hardware, devices, files, ready, options))


def write_ready(path: Path) -> None:
    """Write the file atomically. A failure is logged and does not end the stack."""
    partial = path.with_name(path.name + ".part")
    try:
        partial.write_text(f"{os.getpid()}\n")
        partial.replace(path)
    except OSError as error:
        LOG.warning("cannot write %s: %s", path, error.strerror or error)
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def _simulated_time(rtf: str | None, step: bool) -> "SimulatedTime | None":
    """Return the simulated time that ``--rtf`` and ``--step`` select, or None for real time."""
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
    """Send one pick-and-place goal to a running arm and print its feedback.

    The exit status is 0 if the job succeeds. Example: `servoloop pick B`
    """
    if not grade.strip():
        raise DriverError("GRADE must not be empty; choose a grade, such as A")
    require_ros()
    from nodes.client_node import client_node
    from nodes.pick_place.client import ACTION, PickClient
    from servoloop.stack.signals import Signals

    set_network(network)
    left = "the node may continue the job"
    with Signals(left) as signals, client_node("servoloop_pick") as (node, executor):
        client = PickClient(node, executor)
        available = client.wait(5.0, lambda: signals.count > 0)
        if signals.count:
            raise Interrupted("interrupted before the job began")
        if not available:
            raise DriverError(f"no node provides the action {ACTION}; start the stack and the pick-and-place node")
        outcome = client.pick(
            grade, lambda phase, message: typer.echo(f"{phase}: {message}"), lambda: signals.count > 0
        )
    typer.echo(("done: " if outcome.success else "failed: ") + outcome.message)
    raise typer.Exit(0 if outcome.success else 1)


def demo(
    grades: Annotated[str, typer.Option(help="Grades to pick, separated by commas.")] = "A,B,C",
    repeat: Annotated[int, typer.Option(min=1, help="Number of times to pick all grades.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out/demo"),
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    backlash_deg: BacklashOption = BACKLASH_DEG,
    seed: SeedOption = None,
    record: RecordOption = None,
    view: Annotated[bool, typer.Option("--view", help="Show the arm in a browser.")] = False,
) -> None:
    """Sort cubes with a virtual arm, show the progress and measure the motion.

    With all grades, two more cubes are sorted for comparison: one without gravity compensation and one without lead.
    The exit status is 0 if every cube is in the right bin.
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
        raise DriverError(f"--grades needs grades such as A,B,C, not {grades!r}")
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
