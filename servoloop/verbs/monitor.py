"""``servoloop monitor``: the arm in a terminal."""

import importlib.util
import os
import sys
from pathlib import Path
from typing import Annotated, Final

import typer

from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from servoloop.extras import install_command

NICE: Final = 5
"""The loop that is looked at may run on the same machine: it comes first."""


def monitor(
    recording: Annotated[
        Path | None, typer.Argument(help="FILE.mcap to play; without: the stack that runs on this machine.")
    ] = None,
    arm: Annotated[str | None, typer.Option(help="Which running arm, of several: name, folder or process.")] = None,
) -> None:
    """Show the arm in this terminal: a running stack, or a recording. For a machine without a screen, over ssh.

    It only looks, and ends with q or Ctrl-C; the arm does not notice.
    Example: `servoloop monitor`, of a recording `servoloop monitor out/run.mcap`
    """
    if importlib.util.find_spec("textual") is None:
        raise DriverError(f"the monitor needs textual: {install_command('monitor')}")
    if recording is not None and arm is not None:
        raise DriverError("--arm names a running arm, FILE.mcap is a recording: give one of them")
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise DriverError(
            "the monitor needs a terminal for its keys and its picture, and has none here: run it in one, "
            "over ssh with `ssh -t`"
        )
    from servoloop.live.live_source import LiveSource
    from servoloop.live.playback import Playback
    from servoloop.live.recording import Recording
    from servoloop.monitor.app import MonitorApp
    from servoloop.signals import Signals

    os.nice(NICE)
    clock = MonotonicClock()
    source = LiveSource(arm, clock) if recording is None else Playback(Recording(recording), clock)
    with Signals() as signals:
        app = MonitorApp(source, lambda: signals.count > 0)
        try:
            app.run()
        finally:
            source.close()
    raise typer.Exit(app.return_code or 0)
