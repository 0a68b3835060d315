"""``servoloop up``, ``pick`` and ``demo``: run an arm, send a job to an arm, and demonstrate pick and place."""

import logging
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from commissioning.atomic_write import make_folder, require_file
from drivers.driver_errors import DriverError
from nodes.manager.only_manager import MANAGER, OTHER
from nodes.ros_environment import PLANNING_PACKAGES, require_ros
from servoloop.commands.shared.console import text_console
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import NetworkOption, set_network
from servoloop.commands.shared.other_stacks import search_for_others
from servoloop.demo.cell_options import CellOptions
from servoloop.extras import require_extras
from servoloop.recording.mcap import check_path
from servoloop.stack.arm_options import ControlledArm, NamespaceOption
from servoloop.stack.devices import parse_ports
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.processes import Interrupted
from servoloop.stack.terminal import log_to_terminal
from servoloop.up_options import UpOptions

if TYPE_CHECKING:
    from rich.console import Console

LOG = logging.getLogger("servoloop")
GRADES: Final = ("A", "B", "C")
"""Grades that the demo picks by default."""

HardwareOption = Annotated[
    HardwareKind | None,
    typer.Option(help="Hardware that the control loop drives (default: the plugin named in the URDF)."),
]
PortOption = Annotated[
    list[str] | None,
    typer.Option(help="Serial port of the servos; NAME=PATH for each of several buses (default: virtual servos)."),
]
ReadyFileOption = Annotated[Path | None, typer.Option(help="File that exists while the stack is ready for goals.")]
LONGEST_READY: Final = 32
"""Number of bytes that are read from an existing ready file; a process ID is shorter."""


@grouped_options
def up(
    *,
    hardware: HardwareOption = None,
    port: PortOption = None,
    arm: ControlledArm,
    options: UpOptions,
    network: NetworkOption = False,
    ready_file: ReadyFileOption = None,
) -> None:
    """Run the control stack of an arm until Ctrl-C, with or without ROS 2.

    Example: `servoloop up --port /dev/ttyACM0`; with two buses,
    `servoloop up --port arm=/dev/ttyACM0 --port hand=/dev/ttyUSB0`; with virtual servos at five times real time,
    `servoloop up --rtf 5`
    """
    log_to_terminal()
    if network and not options.ros:
        raise DriverError("--network opens ROS 2 to the network, but --no-ros is given: omit one of them")
    set_network(network)
    check_ready_file(ready_file)
    if options.record is not None:
        check_path(options.record)
    if options.plan:
        _check_planning(options)

    files = arm.read()
    devices = parse_ports(port or [], files.robot.file.lines())
    with search_for_others(MANAGER, OTHER, arm.namespace, options.ros) as search, announced(ready_file) as ready:
        from servoloop.up import OwnControllers  # The search continues in the background during this import.
        from servoloop.up import up as run

        status = run(hardware, devices, files, ready, options, OwnControllers(search))
    raise typer.Exit(status)


def check_ready_file(path: Path | None) -> None:
    """Check that the file for --ready-file can be written, and remove the one of an earlier run. Raises DriverError."""
    if path is None:
        return
    require_file(path)
    if not path.exists():
        return
    if not _is_ready_file(path):
        raise DriverError(f"--ready-file {path} exists and is not a ready file: choose another path, or delete it")
    try:
        path.unlink()
    except OSError as error:
        raise DriverError(f"cannot remove the ready file {path} of an earlier run: {error.strerror}") from error


def _is_ready_file(path: Path) -> bool:
    """Return whether a file is empty or contains only a process ID."""
    try:
        with path.open("rb") as file:
            return re.fullmatch(rb"\d*\n?", file.read(LONGEST_READY)) is not None
    except OSError:
        return False


@contextmanager
def announced(ready_file: Path | None) -> Iterator[Callable[[str], None]]:
    """Yield the function that reports that the stack is ready. Its ready file is removed at the end of the block."""

    def ready(text: str) -> None:
        typer.echo(f"ready: {text}")
        if ready_file is not None:
            write_ready(ready_file)

    try:
        yield ready
    finally:
        if ready_file is not None:
            _remove_ready(ready_file)


def _remove_ready(path: Path) -> None:
    """Remove the ready file of this process. The file of another process is kept."""
    with suppress(OSError):
        if path.read_bytes() == f"{os.getpid()}\n".encode():
            path.unlink()


def _check_planning(options: UpOptions) -> None:
    """Check that the planning server can start, before the torque of the arm is enabled.

    Raises DriverError or RosError.
    """
    if not options.ros:
        raise DriverError("--plan requires ROS 2: omit --no-ros")
    require_extras("motion planning", "planning")
    require_ros(PLANNING_PACKAGES)


def write_ready(path: Path) -> None:
    """Write the file atomically. A failure is logged and does not stop the stack."""
    partial = path.with_name(path.name + ".part")
    try:
        partial.write_text(f"{os.getpid()}\n")
        partial.replace(path)
    except OSError as error:
        LOG.warning("cannot write %s: %s", path, error.strerror or error)
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def pick(
    grade: Annotated[str, typer.Argument(help="Grade of the cube: A, B or C.")],
    action: Annotated[
        str | None, typer.Option(help="Action name of the pick-and-place node (default: sorting/arm/pick_place).")
    ] = None,
    network: NetworkOption = False,
    namespace: NamespaceOption = "",
) -> None:
    """Send one pick-and-place goal to a running arm and print its feedback.

    The exit status is 0 if the job succeeds. Example: `servoloop pick B`
    """
    if not grade.strip():
        raise DriverError("GRADE must not be empty; choose a grade, such as A")
    require_ros()
    from nodes.clients.client_node import client_node
    from nodes.pick_place.client import ACTION, PickClient
    from servoloop.stack.signals import Signals

    set_network(network)
    left = "the node may continue the job"
    with Signals(left) as signals, client_node("servoloop_pick", namespace) as (node, executor):
        client = PickClient(node, executor, action or ACTION)
        available = client.wait(5.0, lambda: signals.count > 0)
        if signals.count:
            raise Interrupted("interrupted before the job began")
        if not available:
            raise DriverError(
                f"no node provides the action {client.action}; start the stack and the pick-and-place node"
            )
        outcome = client.pick(
            grade, lambda phase, message: typer.echo(f"{phase}: {message}"), lambda: signals.count > 0
        )
    typer.echo(("done: " if outcome.success else "failed: ") + outcome.message)
    raise typer.Exit(0 if outcome.success else 1)


@grouped_options
def demo(
    *,
    grades: Annotated[str, typer.Option(help="Grades to pick, separated by commas.")] = ",".join(GRADES),
    repeat: Annotated[int, typer.Option(min=1, help="Number of times to pick all grades.")] = 1,
    options: CellOptions,
) -> None:
    """Sort cubes with a virtual arm, show the progress and measure the motion.

    If all grades are sorted, two more cubes follow for comparison: one without gravity compensation and one without
        lead.
    If the robot has several arms, all arms sort at the same time, without this comparison.
    The exit status is 0 if every cube is in the correct bin.
    Example: `servoloop demo --grades A,C --repeat 3`
    """

    from servoloop.demo import demo as reports
    from servoloop.demo.cell import check_grades
    from servoloop.demo.demo import demo as run
    from servoloop.demo.jobs import Live
    from servoloop.demo.several_arms import arm_jobs, check_options

    jobs = [grade for grade in grades.split(",") if grade.strip()]
    if not jobs:
        raise DriverError(f"--grades needs grades such as A,B,C, not {grades!r}")
    if options.vision and (tuple(jobs) != GRADES or repeat > 1 or options.poses):
        raise DriverError("--vision sorts twelve apples by their own grades: omit --grades, --repeat and --poses")
    several = len(arm_jobs(options)) > 1
    if several:
        check_options(options)
    if options.record is not None:
        check_path(options.record)
    check_grades(jobs, options.found())
    require_ros()
    if options.view:
        require_extras("the view", "view")
    make_folder(options.out)
    console = text_console()
    if options.vision:
        raise typer.Exit(_sort_apples(options, console))
    if several:
        raise typer.Exit(_sort_with_several_arms(jobs, repeat, options, console))
    with Live(console) as live:
        report = run(jobs, repeat, options, live)
    reports.print_table(report, console)
    reports.write_json(report, options.out / "result.json")
    raise typer.Exit(0 if reports.succeeded(report) else 1)


def _sort_with_several_arms(grades: Sequence[str], repeat: int, options: CellOptions, console: "Console") -> int:
    """Sort cubes with all arms at the same time, print the report and return the exit status."""
    from servoloop.demo.jobs import Live
    from servoloop.demo.several_arms import print_report, sort_with_several_arms, write_report

    report = sort_with_several_arms(grades, repeat, options, Live(console))
    print_report(report, console)
    write_report(report, options.out / "result.json")
    return 0 if report.success else 1


def _sort_apples(options: CellOptions, console: "Console") -> int:
    """Sort apples that are graded from camera images, print the report and return the exit status."""
    require_extras("the camera", "sim", "vision")

    from servoloop.demo.jobs import Live
    from servoloop.demo.sort_apples import sort_apples
    from servoloop.demo.sorting import APPLES
    from servoloop.demo.sorting_report import print_sorting, write_sorting

    with Live(console) as live:
        report = sort_apples(options, live, APPLES)
    print_sorting(report, console)
    write_sorting(report, options.out / "result.json")
    return 0 if report.success else 1
