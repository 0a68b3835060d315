"""``servoloop view`` and ``monitor``: show an arm in a browser or in the terminal."""

import os
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.clock import Clock, MonotonicClock
from drivers.driver_errors import DriverError
from nodes.ros_environment import PLANNING_PACKAGES, RosError, require_ros
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.extras import require_extras
from servoloop.stack.arm_options import RunningArm, RunningChoice, RunningNamespace

if TYPE_CHECKING:
    from nodes.planning_client.scene_watch import SceneWatch
    from servoloop.dashboard.live_camera import LiveCamera
    from servoloop.recording.emulator_source import EmulatorSource
    from servoloop.recording.sources import LiveSource, PlayedRecording
    from servoloop.stack.arm_folders import ArmFolder


SCREENS: Final = ("DISPLAY", "WAYLAND_DISPLAY")
"""Environment variables. At least one of them is set on a machine with a display."""
CAMERA_BELOW: Final = 0.25
"""Position of the camera image among the controls, after the buttons and before the *Arm* folder."""


@dataclass(frozen=True, slots=True)
class PageOptions:
    """Options for the page."""

    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="Network port of the page. If it is in use, the next free port is used."),
    ] = 8080
    host: Annotated[
        str, typer.Option(help="Network address of the page. Other machines need the token that is printed.")
    ] = "127.0.0.1"
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True


@grouped_options
def view(
    *,
    recording: Annotated[
        Path | None, typer.Argument(help="MCAP file to play (default: the stack running on this machine).")
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option(
            help="Name, folder or process ID of the arm if several are running. With an MCAP file, the recorded arm."
        ),
    ] = None,
    namespace: RunningNamespace = None,
    bus: Annotated[
        Path | None,
        typer.Option(help="LINK of virtual servos of `servoloop emulate` without a stack. Select the arm with --arm."),
    ] = None,
    page: PageOptions,
) -> None:
    """Show a running arm, a recording or virtual servos in a browser.

    The page works offline. The buttons on the page move a running arm while you hold them. Ctrl-C ends the command
    without affecting the arm. Example: `servoloop view`, or `servoloop view out/run.mcap` for a recording
    """
    require_extras("the view", "view")
    if recording is not None and bus is not None:
        raise DriverError("--bus shows a virtual arm and FILE.mcap shows a recording; use only one of them")
    clock = MonotonicClock()
    found, folder = _opened(recording, bus, RunningChoice(arm, namespace), clock)
    _serve(found, folder, page, clock)


def _serve(
    found: "LiveSource | PlayedRecording | EmulatorSource", folder: Path | None, page: PageOptions, clock: Clock
) -> None:
    """Show the arm of a source on the page until a signal arrives."""
    from servoloop.dashboard.browser import Part, show
    from servoloop.dashboard.camera_folder import CameraFolder
    from servoloop.dashboard.move_panel import MovePanel, Mover
    from servoloop.dashboard.page import Page
    from servoloop.dashboard.player import Player
    from servoloop.dashboard.server import PageServer
    from servoloop.recording.sources import LiveSource, PlayedRecording
    from servoloop.stack.signals import Signals

    with Signals() as signals, ExitStack() as ends:
        watch, camera = None, None
        if isinstance(found, LiveSource):
            watch, camera = _scene_watch(found.stack.namespace), _live_camera(clock, found.stack.namespace)
        for watching in (watch, camera):
            if watching is not None:
                ends.callback(watching.close)
        server = PageServer(page.host, page.port)
        ends.callback(server.stop)
        shown = Page(server, folder, None if watch is None else lambda: (watch.newest, clock.now()))
        cameras = CameraFolder(server, shown.above_arm + CAMERA_BELOW, camera.pictures if camera else None)
        parts: list[Part] = [cameras.show]
        source = Player(server, found, clock) if isinstance(found, PlayedRecording) else found
        ends.callback(source.close)
        if isinstance(found, LiveSource):
            mover = Mover(found, clock)
            ends.callback(mover.close)
            panel = MovePanel(server, mover, shown.above_arm)
            parts.append(lambda _: panel.show())
        typer.echo(f"the page is at {server.url}")
        if page.browser and any(name in os.environ for name in SCREENS):
            typer.launch(server.url)
        show(shown, source, clock, lambda: signals.count > 0, parts)


def _scene_watch(namespace: str) -> "SceneWatch | None":
    """Start watching the arm's motion planner, if ROS 2 is installed."""
    try:
        require_ros(PLANNING_PACKAGES)
    except RosError:
        return None
    from nodes.planning_client.scene_watch import SceneWatch

    watch = SceneWatch(namespace=namespace)
    watch.start()
    return watch


def _live_camera(clock: Clock, namespace: str) -> "LiveCamera | None":
    """Start watching the camera node, if ROS 2 is installed."""
    try:
        require_ros()
    except RosError:
        return None
    from nodes.clients.camera_pictures import PICTURES, PictureWatch
    from servoloop.dashboard.live_camera import LiveCamera

    return LiveCamera(PictureWatch(clock, namespace), PICTURES)


def _opened(
    recording: Path | None, bus: Path | None, choice: RunningChoice, clock: Clock
) -> "tuple[LiveSource | PlayedRecording | EmulatorSource, Path | None]":
    """Open the source and return it with the folder of its arm, or with None if only the arm's URDF is known."""
    from servoloop.recording.sources import LiveSource, PlayedRecording
    from servoloop.stack.arm_folders import find_arm
    from servoloop.stack.shipped_files import OWN

    if recording is not None:
        return PlayedRecording(recording), find_arm(choice.arm).folder if choice.arm is not None else None
    if bus is not None:
        known = find_arm(choice.arm or OWN)
        return _emulated(bus, known, clock), known.folder
    live = LiveSource(choice.arm, clock, choice.namespace)
    return live, live.folder


def _emulated(bus: Path, arm: "ArmFolder", clock: Clock) -> "EmulatorSource":
    from servoloop.recording.emulator_source import EmulatorSource
    from servoloop.stack.robot_files import read_description

    return EmulatorSource(bus, read_description(arm.urdf), clock)


NICE: Final = 5
"""Niceness of the monitor process, so that a control loop on the same machine has priority."""


def monitor(
    recording: Annotated[
        Path | None, typer.Argument(help="MCAP file to play (default: the stack running on this machine).")
    ] = None,
    arm: RunningArm = None,
    namespace: RunningNamespace = None,
) -> None:
    """Show a running arm or a recording in this terminal, for example over ssh.

    The command only displays the arm. Press q or Ctrl-C to end the command without affecting the arm.
    Example: `servoloop monitor`, or `servoloop monitor out/run.mcap` for a recording
    """
    require_extras("the monitor", "monitor")
    if recording is not None and not (arm is None and namespace is None):
        raise DriverError(
            "--arm and --namespace show a running arm and FILE.mcap shows a recording; use only one of them"
        )
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise DriverError(
            "the monitor needs a terminal, but stdin or stderr is not a terminal; run it in a terminal (over ssh, use "
            "`ssh -t`)"
        )
    from servoloop.dashboard.terminal import MonitorApp
    from servoloop.recording.sources import LiveSource, Playback, PlayedRecording
    from servoloop.stack.signals import Signals

    os.nice(NICE)
    clock = MonotonicClock()
    source = LiveSource(arm, clock, namespace) if recording is None else Playback(PlayedRecording(recording), clock)
    with Signals() as signals:
        app = MonitorApp(source, lambda: signals.count > 0)
        try:
            app.run()
        finally:
            source.close()
    raise typer.Exit(app.return_code or 0)
