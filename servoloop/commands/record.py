"""``servoloop record``: a recording of a stack that runs already."""

from contextlib import nullcontext
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final

import typer

from drivers.errors import DriverError
from drivers.printable import counted
from servoloop.commands.console import JsonOption, print_json
from servoloop.commands.options import RATE_HZ, RateOption, SpeedOption, UnattendedOption, require_keys, side_of
from servoloop.commands.teach import played
from servoloop.commands.view import view
from servoloop.extras import install_command
from servoloop.recording.mcap import SUFFIX, check_path
from servoloop.stack.arm_folders import OWN
from servoloop.stack.terminal import print_styled

OUT: Final = Path("out")


def record(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.mcap]", help="Without: below out/, by date and arm.")
    ] = None,
    arm: Annotated[str | None, typer.Option(help="Which running arm, of several: name, folder or process.")] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.0, help="So long; without: until Ctrl-C, or until the stack ends.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Record an arm that runs already: every cycle from now on and all bus traffic, as --record does from the start.

    Example: `servoloop record --seconds 60`
    """
    from servoloop.recording.stack_recording import record as run
    from servoloop.recording.stream import find_stack, open_live
    from servoloop.stack.robot_files import make_folder
    from servoloop.stack.signals import Signals

    if file is not None:
        check_path(file)
    stack = find_stack(arm)
    if file is None:
        file = OUT / f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{stack.arm}{SUFFIX}"
        make_folder(OUT)
    with Signals() as signals:
        typer.echo(f"recording {stack.arm} into {file}; Ctrl-C ends it", err=True)
        done = run(open_live(stack), file, seconds, lambda: signals.count > 0)
    if json:
        print_json({"file": str(file), **asdict(done)})
        return
    end = ", then the stack ended" if done.stack_ended else ""
    lost = f", {done.lost_cycles} between them are missing: this machine was too slow" if done.lost_cycles else ""
    typer.echo(f"{file}: {counted(done.cycles, 'cycle')} in {done.length_s:.1f} s{lost}{end}")


def plot(
    recording: Annotated[Path, typer.Argument(help="FILE.mcap, as --record and out/faults/ have it.")],
    out: Annotated[Path | None, typer.Option(help="The page; beside the recording without.")] = None,
    json: JsonOption = False,
) -> None:
    """Draw a recording: commands and positions, their difference, velocities, efforts, the loop's timing, faults.

    One page that opens without a network. A recording of a program that was killed is drawn as far as it goes.
    Example: `servoloop plot out/run.mcap`
    """
    from rich.console import Console
    from rich.progress import Progress

    from servoloop.campaign.report import possible
    from servoloop.recording.reader import read_recording

    if not possible():
        raise DriverError(f"a page needs matplotlib and Jinja2: {install_command('report')}")
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        run = read_recording(recording, lambda path: progress.open(path, "rb", description=f"reading {path.name}"))
    with console.status(f"drawing {counted(len(run.time_s), 'cycle')}") if console.is_terminal else nullcontext():
        from servoloop.recording.page import write_page  # with matplotlib, which takes a second

        path = out or recording.with_suffix(".html")
        write_page(path, run, recording.name)
    if json:
        print_json({"page": str(path), "cycles": len(run.time_s), "missed": run.missed, "faults": len(run.faults)})
    else:
        typer.echo(
            f"{path}: {counted(len(run.time_s), 'cycle')}, {run.missed} missed, {counted(len(run.faults), 'fault')}"
        )


def replay(
    recording: Annotated[Path, typer.Argument(help="FILE.mcap, as --record writes it.")],
    port: Annotated[
        str | None, typer.Option(help="Serial device of the arm; NAME=PATH,NAME=PATH of several. Without: the view.")
    ] = None,
    arm: Annotated[str, typer.Option(help="The arm: a name that `servoloop arms` lists, or its folder.")] = OWN,
    speed: SpeedOption = 1.0,
    hands_free: UnattendedOption = False,
    rate_hz: RateOption = RATE_HZ,
) -> None:
    """Have an arm do what is in a recording, as long as a key is held: any but q, which ends.

    The arm goes slowly to where the recording begins, then where its joints were measured to be. Without --port the
    recording is shown, as `servoloop view` does. Example: `servoloop replay run.mcap --port /dev/ttyACM0 --speed 0.5`
    """
    from servoloop.teach.recorded import recorded_motion

    if port is None:
        view(recording, arm=None, port=8080, host="127.0.0.1", browser=True)
        return
    require_keys(hands_free)
    side = side_of(arm, port)
    joints = side.files.robot.joints
    followers = [joint.name for joint in side.files.description.joints.values() if joint.mimic is not None]
    names, limits = [joint.name for joint in joints], [joint.limits for joint in joints]
    taught, warnings = recorded_motion(recording, names, limits, followers)
    taught.check([joint.limits for joint in joints], str(recording))
    for warning in warnings:
        print_styled(f"! {warning}", fg="yellow")
    raise typer.Exit(played(side, taught, speed, hands_free, rate_hz))
