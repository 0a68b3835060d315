"""``servoloop bench``: measure the performance of a bus or of an arm."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.commissioning_errors import LARGEST_BAUD, SMALLEST_BAUD
from servoloop.commands.shared.console import JsonOption, YesOption, confirm, print_json, text_console
from servoloop.commands.shared.line_options import PortsOption, interruptible, require_ports, served_devices
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.extras import require_extras
from servoloop.stack.arm_options import ArmOption
from servoloop.stack.shipped_files import OWN

if TYPE_CHECKING:
    from rich.console import Console

    from servoloop.bench.arm import Measured
    from servoloop.bench.figures import ArmFigures, Distribution

app = typer.Typer(no_args_is_help=True, help="Measure the performance of a bus or an arm.")

MOVES = (
    "The arm will move with torque enabled. It moves to its ready pose, moves each joint by up to 0.3 rad, and returns "
    "to its initial position, at no more than a quarter of its speed. Its torque is off at the end. Make sure that the "
    "arm has room. Continue?"
)


@dataclass(frozen=True, slots=True)
class MeasuredServos:
    """Servos of one model on a port."""

    port: Annotated[str, typer.Option(help="Serial port of the servos.")]
    ids: Annotated[str, typer.Option(help="Servo IDs, such as 1-7 or 1,2,5.")] = "1-7"
    model: Annotated[str, typer.Option(help="Servo model.")] = "sts3215"
    baud: Annotated[int, typer.Option(min=SMALLEST_BAUD, max=LARGEST_BAUD, help="Baud rate in bits/s.")] = 1_000_000


@app.command()
@grouped_options
def bus(
    servos: MeasuredServos,
    cycles: Annotated[int, typer.Option(min=1, help="Number of cycles to measure.")] = 1000,
    hold: Annotated[bool, typer.Option("--hold", help="Enable torque on all servos during the measurement.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one line of JSON instead of a table.")] = False,
) -> None:
    """Measure the speed and error rate of a servo bus.

    The command reads and writes all servos as fast as possible. Nothing moves, because each servo is sent the goal that
    it already has. Servos whose torque is off are only read, because a goal would enable their torque. With --hold,
    these servos hold their positions during the measurement, and their torque is disabled at the end. For servos that
    are sent goals, the goal speed and the goal acceleration are set to 0 (no limit). Communication errors are counted
    and do not stop the measurement. The exit status is 1 if a servo does not respond, if the control table of every
    servo differs from that of --model, if the port is lost, or if the torque of a servo may still be on at the end.
    Example: `servoloop bench bus --port /dev/ttyACM0 --ids 1-7`
    """

    from drivers.driver_errors import DriverError
    from servoloop.bench import bus as bench_bus

    with interruptible():
        ids = bench_bus.parse_ids(servos.ids)
        figures = bench_bus.bench_bus(servos.port, ids, servos.model, servos.baud, cycles, hold=hold)
    if json:
        typer.echo(bench_bus.as_json(figures))
    else:
        bench_bus.print_table(figures, text_console())
    if figures.silent_servos:
        silent = ", ".join(map(str, figures.silent_servos))
        raise DriverError(f"no reply from the servo IDs {silent}: check their power and cables, or correct --ids")


@app.command()
def arm(
    port: PortsOption = None,
    arm: ArmOption = OWN,
    out: Annotated[Path, typer.Option(help="HTML page to write.")] = Path("out/bench.html"),
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Measure the bus, control loop, ROS interface and motion of an arm.

    The command writes a report page. The command asks for confirmation, because the arm moves slowly to its ready pose,
    moves its joints one by one, and returns. At the end, the arm torque is disabled, even after Ctrl-C or an error. A
    second Ctrl-C skips the return motion, and the torque may stay enabled. Without ROS, the ROS results are omitted.
    Example: `servoloop bench arm --arm so101 --port /dev/ttyACM0`
    """
    from commissioning.atomic_write import make_folder, require_file
    from drivers.clock import MonotonicClock
    from servoloop.bench.arm import bench_arm
    from servoloop.stack.arm_folders import find_arm, read_arm_servos
    from servoloop.stack.loop_thread import LEFT
    from servoloop.stack.signals import Signals

    require_extras("the report page", "report")
    make_folder(out.parent)
    require_file(out, ".html")
    found = find_arm(arm)
    files = read_arm_servos(found)
    with served_devices(port, files) as devices:
        if not yes:
            require_ports(devices, files.robot.file)
        confirm(MOVES, yes)
        with Signals(LEFT) as signals:
            measured = bench_arm(
                found,
                devices,
                MonotonicClock(),
                signals=lambda: signals.count,
                say=lambda text: typer.echo(text, err=True),
            )
    _report(measured, out, json)


def _report(measured: "Measured", out: Path, json: bool) -> None:
    """Print the results and write the page. The results are printed even if the page cannot be written."""

    from commissioning.atomic_write import write_file
    from drivers.driver_errors import DriverError
    from servoloop.bench.page import page

    if not json:
        print_figures(measured.figures, text_console())
    failed: DriverError | None = None
    try:
        write_file(out, page(measured))
    except DriverError as error:
        failed = error
    if json:
        print_json({"page": None if failed else str(out), **asdict(measured.figures)})
    elif not failed:
        typer.echo(f"Report page: {out}")
    if failed:
        raise failed


def print_figures(figures: "ArmFigures", console: "Console") -> None:
    """Print the results as tables: times in ms, following errors in rad or m."""
    from rich.table import Table

    table = Table("ms", "p50", "p99", "largest", title=figures.arm)
    for name, bus in figures.buses.items():
        times = (bus.p50_us, bus.p99_us, bus.max_us)
        table.add_row(f"bus {name}".rstrip() + ", cycle time", *(f"{time_us / 1e3:.3f}" for time_us in times))
    for name, spread in _spreads(figures).items():
        if spread is not None:
            table.add_row(name, f"{spread.p50_ms:.3f}", f"{spread.p99_ms:.3f}", f"{spread.largest_ms:.3f}")
    console.print(table)
    table = Table("following error", "largest", "RMS while moving", "at rest")
    for one in figures.motions:
        table.add_row(one.joint, f"{one.largest:.4f}", f"{one.rms_moving:.4f}", f"{one.at_rest:.4f}")
    console.print(table)
    missed = f"{figures.loop.missed} of {figures.loop.cycles} cycles missed"
    under_ros = f", {figures.ros.loop.missed} of {figures.ros.loop.cycles} under ROS" if figures.ros else ""
    console.print(missed + under_ros)
    if figures.without_ros:
        console.print(f"ROS was not measured: {figures.without_ros}", highlight=False)


def _spreads(figures: "ArmFigures") -> "dict[str, Distribution | None]":
    loop, ros = figures.loop, figures.ros
    found = {"loop, delay": loop.late, "loop, duration": loop.took}
    if ros is not None:
        found |= {"loop under ROS, delay": ros.loop.late, "loop under ROS, duration": ros.loop.took}
        found |= {"goal to answer": ros.goal_to_answer, "goal to first motion": ros.goal_to_motion}
        found |= {"age of /joint_states": ros.joint_states_age, "jitter of /joint_states": ros.joint_states_jitter}
    return found
