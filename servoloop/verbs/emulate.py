"""``servoloop emulate``: the virtual servos on a pseudo-terminal, for any program."""

import logging
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import DriverError
from drivers.printable import counted
from servoloop.arms.folder import OWN, find_arm, read_arm_servos
from servoloop.files import make_folder
from servoloop.ports import device_paths
from servoloop.processes import end, end_with_parent
from servoloop.realtime import at_ordinary_priority
from servoloop.verbs.arm_options import BACKLASH_DEG, ArmOption, BacklashOption, RobotOption, SeedOption, UrdfOption
from servoloop.verbs.ros_options import log_to_terminal
from servoloop.view.installed import require_view

LOG = logging.getLogger("servoloop")


def emulate(
    link: Annotated[Path, typer.Argument(help="Where to serve the bus: a free path. Several buses: LINK.NAME each.")],
    arm: ArmOption = OWN,
    urdf: UrdfOption = None,
    robot: RobotOption = None,
    backlash_deg: BacklashOption = BACKLASH_DEG,
    seed: SeedOption = None,
    practice: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="An arm that nobody has calibrated, by this seed, on an empty table: see `servoloop hand`.",
        ),
    ] = None,
    box: Annotated[
        bool,
        typer.Option(
            "--box",
            help="Servos as they come from the factory, all with ID 1, none connected: `servoloop hand LINK connect`.",
        ),
    ] = False,
    eeprom: Annotated[
        Path | None, typer.Option(help="File that keeps the servos' EEPROM: read if it is there, renewed as they save.")
    ] = None,
    faults: Annotated[
        Path | None,
        typer.Option(help="YAML file with what is to go wrong, in times since ready: see `servoloop fault --list`."),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Show the arm in a browser: `servoloop view --bus LINK`.")
    ] = False,
    pictures: Annotated[Path | None, typer.Option(help="Folder for a picture and a film of the arm at work.")] = None,
) -> None:
    """Serve the virtual servos with their world on a pseudo-terminal until Ctrl-C.

    Example: `servoloop emulate ./bus`, and then any program that takes a serial port: `./bus`
    """
    from servoloop.emulator import emulate as run
    from servoloop.signals import Signals
    from servoloop.simulation.stack_faults import inventory_of, require_possible_in
    from sim_backend.compiled import compilation_announced
    from sim_backend.faults.script import read_script
    from sim_backend.mechanics.build import Build

    log_to_terminal()
    if view:
        require_view()
    if not link.name:
        raise DriverError(f"LINK is a free path such as ./bus, not {str(link)!r}")
    if pictures is not None:
        make_folder(pictures)
    files = read_arm_servos(find_arm(arm), urdf, robot)
    events = read_script(faults) if faults is not None else ()
    if faults is not None and not box:
        require_possible_in(faults, events, replace(inventory_of(files.robot), stack=False), ())
    places = " and ".join(str(path) for path in device_paths(link, files.robot.file.lines()).values())
    if view and urdf is not None:
        raise DriverError("--view shows the arm of --arm: leave out --urdf")
    with Signals() as signals, _page(link, arm, view) as show, compilation_announced(LOG.info):
        run(
            files,
            link,
            pictures,
            Build(backlash_deg, seed, 0 if box and practice is None else practice, box),
            eeprom,
            events,
            stop=lambda: signals.count > 0,
            on_ready=lambda: show(f"ready: {counted(len(files.robot.joints), 'servo')} at {places}"),
        )


@contextmanager
def _page(link: Path, arm: str, wanted: bool) -> Iterator[Callable[[str], None]]:
    """Say that the servos are ready, and have a program of its own show them where that is wanted."""
    pages: list[subprocess.Popen[bytes]] = []

    def show(ready: str) -> None:
        typer.echo(ready)
        if wanted:
            command = [sys.executable, "-m", "servoloop", "view", "--bus", str(link), "--arm", arm]
            pages.append(subprocess.Popen(command, preexec_fn=_as_child))

    try:
        yield show
    finally:
        for page in pages:
            end(page)


def _as_child() -> None:
    at_ordinary_priority()  # this program has real-time priority
    end_with_parent()
