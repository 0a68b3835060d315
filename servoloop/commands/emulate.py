"""``servoloop emulate`` and ``fault``: serve virtual servos on a pseudo-terminal, and inject faults into them."""

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

from commissioning.atomic_write import make_folder
from drivers.driver_errors import DriverError
from drivers.printable import counted
from servoloop.commands.shared.console import JsonOption, print_json
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.extras import require_extras
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from servoloop.stack.arm_options import ArmOption, RobotOption, UrdfOption, XacroOption, xacro_arguments
from servoloop.stack.devices import device_paths
from servoloop.stack.emulator_options import EmulatorOptions
from servoloop.stack.processes import at_ordinary_priority, end, end_with_parent
from servoloop.stack.robot_files import ServoFiles
from servoloop.stack.shipped_files import OWN
from servoloop.stack.terminal import log_to_terminal

if TYPE_CHECKING:
    from sim_backend.faults.events import FaultEvent


LOG = logging.getLogger("servoloop")
LinkArgument = Annotated[
    Path, typer.Argument(help="Unused path for the bus's serial port. With several buses, each port is at LINK.NAME.")
]


@grouped_options
def emulate(
    *,
    link: LinkArgument,
    arm: ArmOption = OWN,
    urdf: UrdfOption = None,
    robot: RobotOption = None,
    xacro_arg: XacroOption = None,
    options: EmulatorOptions,
) -> None:
    """Serve virtual servos and their simulated scene on a pseudo-terminal until Ctrl-C.

    Any program can open LINK as a serial port. Example: `servoloop emulate ./bus`
    """
    require_extras("the emulator", "sim", *(("view",) if options.view else ()))
    from servoloop.stack.emulator import emulate as run
    from servoloop.stack.signals import Signals
    from sim_backend.compiled import compilation_announced

    log_to_terminal()
    if options.view:
        _require_page(urdf)
    _require_paths(link, options.pictures)
    files = read_arm_servos(find_arm(arm), urdf, robot, xacro_arguments(xacro_arg))
    events = _events(options.faults, files, options.box)
    ready = _ready(link, files)
    with Signals() as signals, _page(link, arm, options.view) as show, compilation_announced(LOG.info):
        run(files, link, options, events, stop=lambda: signals.count > 0, on_ready=lambda: show(ready))


def _require_page(urdf: Path | None) -> None:
    """Raise DriverError if the arm cannot be shown in a browser."""
    if urdf is not None:
        raise DriverError("--view always shows the arm of --arm and cannot be combined with --urdf")


def _require_paths(link: Path, pictures: Path | None) -> None:
    """Check the bus path and create the image folder. Raises DriverError."""
    if not link.name:
        raise DriverError(f"LINK must be an unused path such as ./bus, not {str(link)!r}")
    if pictures is not None:
        make_folder(pictures)


def _events(faults: Path | None, files: ServoFiles, box: bool) -> "Sequence[FaultEvent]":
    """Read the fault file. Raises FaultError if a fault cannot affect the servos."""
    from servoloop.simulation.stack_faults import inventory_of, require_possible_in
    from sim_backend.faults.script import read_script

    if faults is None:
        return ()
    events = read_script(faults)
    if not box:
        require_possible_in(faults, events, replace(inventory_of(files), stack=False), ())
    return events


def _ready(link: Path, files: ServoFiles) -> str:
    """Return the line to print when clients can open the buses."""
    places = " and ".join(str(path) for path in device_paths(link, files.robot.file.lines()).values())
    return f"ready: {counted(len(files.robot.joints), 'servo')} at {places}"


@contextmanager
def _page(link: Path, arm: str, wanted: bool) -> Iterator[Callable[[str], None]]:
    """Yield a function that reports that the servos are ready and, if requested, starts the view in its own process."""
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
    at_ordinary_priority()  # the emulator itself has real-time priority
    end_with_parent()


def fault(
    link: Annotated[Path | None, typer.Argument(help="Path at which `servoloop emulate` serves the bus.")] = None,
    what: Annotated[
        list[str] | None,
        typer.Argument(help="Fault kind and parameters, such as silent id=3 for=2s. If omitted, list active faults."),
    ] = None,
    clear: Annotated[
        bool,
        typer.Option("--clear", help="Remove the faults that match WHAT, or all faults if WHAT is omitted."),
    ] = False,
    kinds: Annotated[bool, typer.Option("--list", help="List all fault kinds with their parameters.")] = False,
    json: JsonOption = False,
) -> None:
    """Inject a fault into virtual servos, now or after a delay (`at=2s`).

    Example: `servoloop fault ./bus silent id=3`, then `servoloop fault ./bus --clear silent`
    """
    from sim_backend.control import ask, control_path

    if kinds:
        _list(json)
        return
    if link is None:
        raise DriverError("pass the LINK of the emulator, such as ./bus; `servoloop fault --list` lists all faults")
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
        for word, key in (("done", "done"), ("removed", "taken_back"), ("active", "active"), ("pending", "coming"))
        for text in found[key]
    ]
    typer.echo("\n".join(lines) or "no faults")


def _list(json: bool) -> None:
    from sim_backend.faults.events import KINDS
    from sim_backend.faults.text import usage, words

    if json:
        print_json({name: {"does": does(name), "parameters": list(words(kind))} for name, kind in KINDS.items()})
        return
    for name, kind in KINDS.items():
        typer.echo(f"{usage(kind)}\n    {does(name)}")


def does(kind: str) -> str:
    """Return a sentence that describes a fault type."""
    from sim_backend.faults.events import KINDS

    return " ".join((KINDS[kind].__doc__ or "").split("\n\n")[0].split())
