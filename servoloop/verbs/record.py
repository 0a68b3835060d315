"""``servoloop record``: a recording of a stack that runs already."""

from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final

import typer

from drivers.printable import counted
from servoloop.recorder.record_option import SUFFIX, check_path
from servoloop.verbs.output import JsonOption, print_json

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
    from servoloop.files import make_folder
    from servoloop.live.folder import find_stack
    from servoloop.live.live_recording import record as run
    from servoloop.live.stream import open_live
    from servoloop.signals import Signals

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
