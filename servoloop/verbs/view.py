"""``servoloop view``: the arm in a browser."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.clock import Clock, MonotonicClock
from drivers.errors import DriverError
from servoloop.view.installed import require_view

if TYPE_CHECKING:
    from servoloop.arms.folder import Arm
    from servoloop.live.emulator_source import EmulatorSource
    from servoloop.live.live_source import LiveSource
    from servoloop.live.recording import Recording

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
    from servoloop.live.live_source import LiveSource
    from servoloop.live.recording import Recording
    from servoloop.signals import Signals
    from servoloop.view.move_panel import MovePanel
    from servoloop.view.mover import Mover
    from servoloop.view.page import Page
    from servoloop.view.player import Player
    from servoloop.view.server import PageServer
    from servoloop.view.view import show

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
    from servoloop.arms.folder import OWN, find_arm
    from servoloop.live.live_source import LiveSource
    from servoloop.live.recording import Recording

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
    from servoloop.live.emulator_source import EmulatorSource

    return EmulatorSource(bus, parse_urdf(read_xml(arm.urdf, DescriptionError)), clock)
