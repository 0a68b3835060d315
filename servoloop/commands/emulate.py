"""``servoloop emulate``: the virtual servos on a pseudo-terminal, for any program."""

import logging
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivers.errors import DriverError
from drivers.printable import counted
from servoloop.commands.console import JsonOption, print_json
from servoloop.commands.options import (
    BACKLASH_DEG,
    ArmOption,
    BacklashOption,
    RobotOption,
    SeedOption,
    UrdfOption,
)
from servoloop.dashboard.browser import require_view
from servoloop.stack.arm_folders import OWN, find_arm, read_arm_servos
from servoloop.stack.devices import device_paths
from servoloop.stack.processes import at_ordinary_priority, end, end_with_parent
from servoloop.stack.robot_files import ServoFiles, make_folder
from servoloop.stack.terminal import log_to_terminal

if TYPE_CHECKING:
    from sim_backend.faults.events import FaultEvent


LOG = logging.getLogger("servoloop")
LinkArgument = Annotated[
    Path, typer.Argument(help="Where to serve the bus: a free path. Several buses: LINK.NAME each.")
]
PracticeOption = Annotated[
    int | None,
    typer.Option(
        min=0, help="An arm that nobody has calibrated, by this seed, on an empty table: see `servoloop hand`."
    ),
]
BoxOption = Annotated[
    bool,
    typer.Option(
        "--box",
        help="Servos as they come from the factory, all with ID 1, none connected: `servoloop hand LINK connect`.",
    ),
]
EepromOption = Annotated[
    Path | None, typer.Option(help="File that keeps the servos' EEPROM: read if it is there, renewed as they save.")
]
FaultsOption = Annotated[
    Path | None,
    typer.Option(help="YAML file with what is to go wrong, in times since ready: see `servoloop fault --list`."),
]
ViewOption = Annotated[bool, typer.Option("--view", help="Show the arm in a browser: `servoloop view --bus LINK`.")]
PicturesOption = Annotated[Path | None, typer.Option(help="Folder for a picture and a film of the arm at work.")]


def emulate(
    link: LinkArgument,
    arm: ArmOption = OWN,
    urdf: UrdfOption = None,
    robot: RobotOption = None,
    backlash_deg: BacklashOption = BACKLASH_DEG,
    seed: SeedOption = None,
    practice: PracticeOption = None,
    box: BoxOption = False,
    eeprom: EepromOption = None,
    faults: FaultsOption = None,
    view: ViewOption = False,
    pictures: PicturesOption = None,
) -> None:
    """Serve the virtual servos with their world on a pseudo-terminal until Ctrl-C.

    Example: `servoloop emulate ./bus`, and then any program that takes a serial port: `./bus`
    """
    from servoloop.stack.emulator import EmulatorOptions
    from servoloop.stack.emulator import emulate as run
    from servoloop.stack.signals import Signals
    from sim_backend.buses.build import Build
    from sim_backend.compiled import compilation_announced

    log_to_terminal()
    if view:
        _require_page(urdf)
    _require_paths(link, pictures)
    files = read_arm_servos(find_arm(arm), urdf, robot)
    events = _events(faults, files, box)
    build = Build(backlash_deg, seed, 0 if box and practice is None else practice, box)
    options = EmulatorOptions(build, pictures, eeprom, events)
    ready = _ready(link, files)
    with Signals() as signals, _page(link, arm, view) as show, compilation_announced(LOG.info):
        run(files, link, options, stop=lambda: signals.count > 0, on_ready=lambda: show(ready))


def _require_page(urdf: Path | None) -> None:
    """Check that the arm can be shown in a browser. Raises DriverError."""
    require_view()
    if urdf is not None:
        raise DriverError("--view shows the arm of --arm: leave out --urdf")


def _require_paths(link: Path, pictures: Path | None) -> None:
    """Check the place of the bus, and make the folder of the pictures. Raises DriverError."""
    if not link.name:
        raise DriverError(f"LINK is a free path such as ./bus, not {str(link)!r}")
    if pictures is not None:
        make_folder(pictures)


def _events(faults: Path | None, files: ServoFiles, box: bool) -> "Sequence[FaultEvent]":
    """The faults of the file, which the servos can have. Raises FaultError."""
    from servoloop.simulation.stack_faults import inventory_of, require_possible_in
    from sim_backend.faults.script import read_script

    if faults is None:
        return ()
    events = read_script(faults)
    if not box:
        require_possible_in(faults, events, replace(inventory_of(files), stack=False), ())
    return events


def _ready(link: Path, files: ServoFiles) -> str:
    """The line that is printed once clients can open the buses."""
    places = " and ".join(str(path) for path in device_paths(link, files.robot.file.lines()).values())
    return f"ready: {counted(len(files.robot.joints), 'servo')} at {places}"


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


def fault(
    link: Annotated[Path | None, typer.Argument(help="Where `servoloop emulate` serves the bus.")] = None,
    what: Annotated[
        list[str] | None,
        typer.Argument(help="A kind and its parameters, such as silent id=3 for=2s; without: the faults that are on."),
    ] = None,
    clear: Annotated[
        bool, typer.Option("--clear", help="Take back the faults of this kind and these parameters; without WHAT, all.")
    ] = False,
    kinds: Annotated[bool, typer.Option("--list", help="All kinds, and how each is typed.")] = False,
    json: JsonOption = False,
) -> None:
    """Let something go wrong with virtual servos, now or `at=` so many seconds from now.

    Example: `servoloop fault ./bus silent id=3`, taken back by `servoloop fault ./bus --clear silent`
    """
    from sim_backend.control import ask, control_path

    if kinds:
        _list(json)
        return
    if link is None:
        raise DriverError("name the emulator's LINK, such as ./bus; `servoloop fault --list` shows all kinds")
    command: dict[str, Any] = {"do": "fault", "clear": clear}
    if what:
        command["text"] = what[0] if len(what) == 1 else shlex.join(what)
    try:
        found = ask(control_path(link), command)
    except ValueError as error:
        raise DriverError(str(error)) from error
    if json:
        print_json(found)
        return
    lines = [
        f"{word}: {text}"
        for word, key in (("done", "done"), ("taken back", "taken_back"), ("on", "active"), ("coming", "coming"))
        for text in found[key]
    ]
    typer.echo("\n".join(lines) or "nothing is wrong")


def _list(json: bool) -> None:
    from sim_backend.faults.events import KINDS
    from sim_backend.faults.text import usage, words

    if json:
        print_json({name: {"does": does(name), "parameters": list(words(kind))} for name, kind in KINDS.items()})
        return
    for name, kind in KINDS.items():
        typer.echo(f"{usage(kind)}\n    {does(name)}")


def does(kind: str) -> str:
    """What a kind does, in a sentence."""
    from sim_backend.faults.events import KINDS

    return " ".join((KINDS[kind].__doc__ or "").split("\n\n")[0].split())
