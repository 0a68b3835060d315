"""``servoloop plot``: a recording as one page."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import DriverError
from drivers.printable import counted
from servoloop.extras import install_command
from servoloop.verbs.output import JsonOption, print_json


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
    from servoloop.recorder.reader import read_recording

    if not possible():
        raise DriverError(f"a page needs matplotlib and Jinja2: {install_command('report')}")
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        run = read_recording(recording, lambda path: progress.open(path, "rb", description=f"reading {path.name}"))
    with console.status(f"drawing {counted(len(run.time_s), 'cycle')}") if console.is_terminal else nullcontext():
        from servoloop.recorder.page import write_page  # with matplotlib, which takes a second

        path = out or recording.with_suffix(".html")
        write_page(path, run, recording.name)
    if json:
        print_json({"page": str(path), "cycles": len(run.time_s), "missed": run.missed, "faults": len(run.faults)})
    else:
        typer.echo(
            f"{path}: {counted(len(run.time_s), 'cycle')}, {run.missed} missed, {counted(len(run.faults), 'fault')}"
        )
