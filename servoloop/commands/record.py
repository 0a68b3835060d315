"""``servoloop record``, ``plot`` and ``replay``: record a running stack, plot a recording, and repeat its motion."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from commissioning.atomic_write import require_output
from drivers.driver_errors import DriverError
from drivers.printable import counted
from hal.plausible import RANGES
from hal.types import JointLimits
from servoloop.commands.shared.console import JsonOption, print_json, text_console
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.teach import PlayOptions, SelectedArm, play_motion
from servoloop.commands.view import view
from servoloop.extras import require_extras
from servoloop.recording.mcap import SUFFIX, check_path
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.arm_options import RunningArm, RunningNamespace
from servoloop.stack.terminal import print_styled

if TYPE_CHECKING:
    from servoloop.teach.motion_files import RecordedMotion

OUT: Final = Path("out")
LONGEST_S: Final = RANGES["time"].highest
"""Maximum length of a recording with a limit, in seconds."""


def record(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.mcap]", help="File to write (default: out/DATE_ARM.mcap).")
    ] = None,
    arm: RunningArm = None,
    namespace: RunningNamespace = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.0, help="Duration in seconds (default: until Ctrl-C or until the stack ends).")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Record every cycle and all bus traffic of a running arm.

    To record from the start, use `servoloop up --record`. Example: `servoloop record --seconds 60`
    """
    from commissioning.atomic_write import make_folder
    from servoloop.recording.stack_recording import record as run
    from servoloop.recording.stream import find_stack, open_live
    from servoloop.stack.signals import Signals

    if file is not None:
        check_path(file)
    if seconds is not None and seconds > LONGEST_S:
        raise DriverError(
            f"--seconds must be 0 to {LONGEST_S:.0f}, not {seconds}: omit --seconds to record without a limit"
        )
    stack = find_stack(arm, namespace)
    if file is None:
        file = OUT / f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{stack.file_name}{SUFFIX}"
        make_folder(OUT)
    with Signals() as signals:
        typer.echo(f"Recording {stack.name} to {file}; press Ctrl-C to stop.", err=True)
        done = run(open_live(stack), file, seconds, lambda: signals.count > 0)
    if json:
        print_json({"file": str(file), **asdict(done)})
        return
    end = "; the stack has ended" if done.stack_ended else ""
    lost = f"; {done.lost_cycles} cycles are missing because this machine was too slow" if done.lost_cycles else ""
    typer.echo(f"{file}: {counted(done.cycles, 'cycle')} in {done.length_s:.1f} s{lost}{end}")


def plot(
    recording: Annotated[Path, typer.Argument(help="MCAP file, from --record or out/faults/.")],
    out: Annotated[Path | None, typer.Option(help="HTML page to write (default: next to the recording).")] = None,
    json: JsonOption = False,
) -> None:
    """Plot a recording on a web page.

    The plots show commands, positions, velocities, efforts, control loop timing and faults. The page works offline. If
    the recorded program was killed, the complete part of its recording is plotted.
    Example: `servoloop plot out/run.mcap`
    """
    from rich.markup import escape
    from rich.progress import Progress

    from servoloop.recording.reader import read_recording

    require_extras("the page", "report")
    path = out or recording.with_suffix(".html")
    require_output(path, recording, ".html")
    console = text_console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        run = read_recording(
            recording, lambda path: progress.open(path, "rb", description=escape(f"reading {path.name}"))
        )
    with console.status(f"drawing {counted(len(run.time_s), 'cycle')}") if console.is_terminal else nullcontext():
        from servoloop.recording.page import write_page  # This imports matplotlib, which takes a second.

        write_page(path, run, recording.name)
    if json:
        print_json({"page": str(path), "cycles": len(run.time_s), "missed": run.missed, "faults": len(run.faults)})
    else:
        typer.echo(
            f"{path}: {counted(len(run.time_s), 'cycle')}, {run.missed} missed, {counted(len(run.faults), 'fault')}"
        )


@grouped_options
def replay(
    *,
    recording: Annotated[Path, typer.Argument(help="MCAP file, from --record.")],
    running: Annotated[
        bool, typer.Option("--running", help="Move the arm of the running `servoloop up` instead of an arm on a port.")
    ] = False,
    selected: SelectedArm,
    options: PlayOptions,
) -> None:
    """Repeat the motion of a recording on an arm while you hold a key.

    Any key except q can be held; q ends the command. The arm first moves slowly to the start of the recording. Then the
    arm follows the recorded joint positions. Without --port and --running, the recording is only shown, as with
    `servoloop view`.
    Example: `servoloop replay run.mcap --port /dev/ttyACM0 --speed 0.5`
    """
    if running and selected.port:
        raise DriverError("--running moves the arm of `servoloop up`, which already uses the port: omit --port")
    if not running and not selected.port:
        _require_no_motion_options(selected, options)
        view(recording=recording, arm=None, namespace=None, bus=None, port=8080, host="127.0.0.1", browser=True)
        return
    play_motion(selected, partial(_recorded_motion, recording), options)


def _require_no_motion_options(selected: SelectedArm, options: PlayOptions) -> None:
    """Raise DriverError if an option for a motion is given, but the recording is only displayed."""
    unset = PlayOptions()
    given = {
        "--arm": selected.arm is not None,
        "--namespace": selected.namespace is not None,
        "--speed": options.speed != unset.speed,
        "--hands-free": options.hands_free,
    }
    if names := [name for name, is_given in given.items() if is_given]:
        raise DriverError(f"{names[0]} applies only if the arm moves: add --port or --running, or omit {names[0]}")


def _recorded_motion(
    recording: Path, folder: Path | None, joints: Sequence[str], limits: Sequence[JointLimits]
) -> "RecordedMotion":
    """Return the motion contained in a recording. Raises TeachError if the recording does not match the arm."""
    from servoloop.teach.recorded import recorded_motion

    described = read_arm_files(find_arm(str(folder))).description.joints.values() if folder is not None else ()
    followers = [joint.name for joint in described if joint.mimic is not None]
    motion, warnings = recorded_motion(recording, joints, limits, followers)
    motion.check(limits, str(recording))
    for warning in warnings:
        print_styled(f"! {warning}", fg="yellow")
    return motion
