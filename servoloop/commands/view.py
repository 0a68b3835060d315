"""``servoloop view``: the arm in a browser."""

import importlib.util
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.clock import Clock, MonotonicClock
from drivers.errors import DriverError
from servoloop.dashboard.browser import require_view
from servoloop.extras import install_command

if TYPE_CHECKING:
    from servoloop.recording.emulator_source import EmulatorSource
    from servoloop.recording.sources import LiveSource, Recording
    from servoloop.stack.arm_folders import Arm


SCREENS: Final = ("DISPLAY", "WAYLAND_DISPLAY")
"""The variables one of which is set where there is a screen."""


def view(
    recording: Annotated[
        Path | None, typer.Argument(help="FILE.mcap to play; without: the stack that runs on this machine.")
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option(help="Which running arm, of several: name, folder or process. With FILE.mcap: the recorded arm."),
    ] = None,
    bus: Annotated[
        Path | None, typer.Option(help="The virtual arm (--arm) that `servoloop emulate` serves there, with no stack.")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Where it is taken, the next free one is used.")] = 8080,
    host: Annotated[
        str, typer.Option(help="Address of this machine at which others may open the page, with the token it prints.")
    ] = "127.0.0.1",
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
) -> None:
    """Show the arm in a browser: a running stack, a recording, or virtual servos that another program moves.

    One page on this machine, which needs no other network. Buttons move a running arm as long as they are held.
    It ends with Ctrl-C; the arm does not notice.
    Example: `servoloop view`, of a recording `servoloop view out/run.mcap`
    """
    require_view()
    if recording is not None and bus is not None:
        raise DriverError("--bus names a running arm, FILE.mcap is a recording: give one of them")
    from servoloop.dashboard.browser import show
    from servoloop.dashboard.move_panel import MovePanel, Mover
    from servoloop.dashboard.page import Page
    from servoloop.dashboard.player import Player
    from servoloop.dashboard.server import PageServer
    from servoloop.recording.sources import LiveSource, Recording
    from servoloop.stack.signals import Signals

    clock = MonotonicClock()
    found, folder = _opened(recording, bus, arm, clock)
    with Signals() as signals:
        server = PageServer(host, port)
        page = Page(server, folder)
        mover = Mover(found, clock) if isinstance(found, LiveSource) else None
        panel = MovePanel(server, mover, page.above_arm) if mover else None
        source = Player(server, found, clock) if isinstance(found, Recording) else found
        typer.echo(f"the page is at {server.url}")
        if browser and any(name in os.environ for name in SCREENS):
            typer.launch(server.url)
        try:
            show(page, source, clock, lambda: signals.count > 0, panel)
        finally:
            if mover is not None:
                mover.close()
            source.close()
            server.stop()


def _opened(
    recording: Path | None, bus: Path | None, arm: str | None, clock: Clock
) -> "tuple[LiveSource | Recording | EmulatorSource, Path | None]":
    """Open the source, and find the folder of its arm; None if only the robot description tells which arm it is."""
    from servoloop.recording.sources import LiveSource, Recording
    from servoloop.stack.arm_folders import OWN, find_arm

    if recording is not None:
        return Recording(recording), find_arm(arm).folder if arm is not None else None
    if bus is not None:
        known = find_arm(arm or OWN)
        return _emulated(bus, known, clock), known.folder
    live = LiveSource(arm, clock)
    return live, live.folder


def _emulated(bus: Path, arm: "Arm", clock: Clock) -> "EmulatorSource":
    from hal.errors import DescriptionError
    from hal.robot_description.description import parse_urdf
    from hal.text_file import read_xml
    from servoloop.recording.emulator_source import EmulatorSource

    return EmulatorSource(bus, parse_urdf(read_xml(arm.urdf, DescriptionError)), clock)


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
    from servoloop.dashboard.terminal import MonitorApp
    from servoloop.recording.sources import LiveSource, Playback, Recording
    from servoloop.stack.signals import Signals

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
