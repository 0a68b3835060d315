"""``servoloop view``: the arm in a browser."""

import os
from pathlib import Path
from typing import Annotated, Final

import typer

from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from servoloop.view.installed import require_view

SCREENS: Final = ("DISPLAY", "WAYLAND_DISPLAY")
"""The variables one of which is set where there is a screen."""


def view(
    recording: Annotated[
        Path | None, typer.Argument(help="FILE.mcap to play; without: the stack that runs on this machine.")
    ] = None,
    arm: Annotated[str | None, typer.Option(help="Which running arm, of several: name, folder or process.")] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Where it is taken, the next free one is used.")] = 8080,
    host: Annotated[
        str, typer.Option(help="Address of this machine at which others may open the page, with the token it prints.")
    ] = "127.0.0.1",
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
) -> None:
    """Show the arm in a browser: a running stack, or a recording.

    One page on this machine, which needs no other network. Buttons move a running arm as long as they are held.
    It ends with Ctrl-C; the arm does not notice.
    Example: `servoloop view`, of a recording `servoloop view out/run.mcap`
    """
    require_view()
    if recording is not None and arm is not None:
        raise DriverError("--arm names a running arm, FILE.mcap is a recording: give one of them")
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
    found = LiveSource(arm, clock) if recording is None else Recording(recording)
    with Signals() as signals:
        server = PageServer(host, port)
        page = Page(server)
        mover = Mover(found, clock) if isinstance(found, LiveSource) else None
        panel = MovePanel(server, mover, page.above_arm) if mover else None
        source = found if isinstance(found, LiveSource) else Player(server, found, clock)
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
