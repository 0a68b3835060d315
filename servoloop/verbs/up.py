"""``servoloop up``: the stack of one arm under ROS 2."""

import logging
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivers.errors import DriverError
from servoloop.arms.folder import OWN, find_arm, read_arm_files
from servoloop.files import require_writable
from servoloop.hardware import HardwareKind
from servoloop.ports import parse_ports
from servoloop.recorder.record_option import RecordOption, check_path
from servoloop.verbs.arm_options import BACKLASH_DEG, ArmOption, RobotOption, UrdfOption
from servoloop.verbs.ros_options import NetworkOption, log_to_terminal, set_network

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
            raise DriverError(f"--ready-file {ready_file} is a folder: name a file")
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
    from sim_backend.mechanics.build import Build

    return SimulatedTime(Pace(parse_factor("max" if rtf is None else rtf), paused=step), Build(BACKLASH_DEG))
