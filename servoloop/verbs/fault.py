"""``servoloop fault``: something goes wrong with the servos of a running emulator."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import DriverError
from servoloop.verbs.output import JsonOption, print_json


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
