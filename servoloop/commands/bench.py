"""``servoloop bench``: measure what is connected."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from commissioning.errors import LARGEST_BAUD, SMALLEST_BAUD
from servoloop.commands.console import JsonOption, YesOption, confirm, print_json
from servoloop.commands.line_options import PortsOption, interruptible, served_devices
from servoloop.commands.options import ArmOption
from servoloop.extras import install_command
from servoloop.stack.arm_folders import OWN

if TYPE_CHECKING:
    from rich.console import Console

    from servoloop.bench.figures import ArmFigures, Spread

app = typer.Typer(no_args_is_help=True, help="Measure what is connected.")

MOVES = (
    "Torque goes on, the arm goes from where it lies to its ready pose, each joint turns there by up to 0.3 rad, and "
    "it comes back and is let go, all with at most a quarter of its speed. See that it has room. Go on?"
)


@app.command()
def bus(
    port: Annotated[str, typer.Option(help="Serial device of the servos.")],
    ids: Annotated[str, typer.Option(help="Servo IDs, such as 1-7 or 1,2,5.")] = "1-7",
    model: Annotated[str, typer.Option(help="Servo model.")] = "sts3215",
    baud: Annotated[int, typer.Option(min=SMALLEST_BAUD, max=LARGEST_BAUD, help="Bits per second.")] = 1_000_000,
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

    from servoloop.bench import bus as bench_bus

    with interruptible():
        figures = bench_bus.bench_bus(port, bench_bus.parse_ids(ids), model, baud, cycles, hold=hold)
    if json:
        typer.echo(bench_bus.as_json(figures))
    else:
        bench_bus.print_table(figures, Console())


@app.command()
def arm(
    port: PortsOption = None,
    arm: ArmOption = OWN,
    out: Annotated[Path, typer.Option(help="The page.")] = Path("out/bench.html"),
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Measure bus, control loop, ROS surface and motions of an arm on this machine, and draw one page.

    It asks first, for the arm moves: slowly, from where it lies to its ready pose, joint by joint, and back. It is let
    go there, also after Ctrl-C and after an error; a second Ctrl-C leaves servos under torque where they are. Without
    ROS its figures are left out.
    Example: `servoloop bench arm --arm so101 --port /dev/ttyACM0`
    """
    from rich.console import Console

    from drivers.clock import MonotonicClock
    from drivers.errors import DriverError
    from servoloop.bench.arm import bench_arm
    from servoloop.campaign.report import possible
    from servoloop.stack.arm_folders import find_arm, read_arm_servos
    from servoloop.stack.loop_thread import LEFT
    from servoloop.stack.robot_files import make_folder, require_file, write_file
    from servoloop.stack.signals import Signals

    if not possible():
        raise DriverError(f"a page needs matplotlib and Jinja2: {install_command('report')}")
    make_folder(out.parent)
    require_file(out)
    found = find_arm(arm)
    with served_devices(port, read_arm_servos(found)) as devices:
        confirm(MOVES, yes)
        with Signals(LEFT) as signals:
            measured = bench_arm(
                found,
                devices,
                MonotonicClock(),
                signals=lambda: signals.count,
                say=lambda text: typer.echo(text, err=True),
            )
    from servoloop.bench.page import page

    if not json:
        print_figures(measured.figures, Console())
    failed: DriverError | None = None
    try:
        write_file(out, page(measured))
    except DriverError as error:
        failed = error
    if json:
        print_json({"page": None if failed else str(out), **asdict(measured.figures)})
    elif not failed:
        typer.echo(f"with pictures: {out}")
    if failed:
        raise failed


def print_figures(figures: "ArmFigures", console: "Console") -> None:
    """For people: times in ms, errors in rad or m."""
    from rich.table import Table

    table = Table("ms", "p50", "p99", "largest", title=figures.arm)
    for name, bus in figures.buses.items():
        times = (bus.p50_us, bus.p99_us, bus.max_us)
        table.add_row(f"bus {name}".rstrip() + ", a cycle", *(f"{time_us / 1e3:.3f}" for time_us in times))
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
        console.print(f"nothing of ROS: {figures.without_ros}", highlight=False)


def _spreads(figures: "ArmFigures") -> "dict[str, Spread | None]":
    loop, ros = figures.loop, figures.ros
    found = {"loop, late": loop.late, "loop, busy": loop.took}
    if ros is not None:
        found |= {"under ROS, late": ros.loop.late, "under ROS, busy": ros.loop.took}
        found |= {"goal to answer": ros.goal_to_answer, "goal to first motion": ros.goal_to_motion}
        found |= {"age of /joint_states": ros.joint_states_age, "their jitter": ros.joint_states_jitter}
    return found
