"""How tools print: one JSON document for programs, tables for people."""

import json
from dataclasses import asdict, is_dataclass
from typing import Annotated, Any

import typer

from drivers.errors import DriverError

JsonOption = Annotated[bool, typer.Option("--json", help="One JSON document instead of tables.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask.")]


def print_json(value: Any) -> None:
    """Print a dataclass, or a list or mapping of them."""
    typer.echo(json.dumps(value, default=_plain, indent=2))


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def confirm(question: str, yes: bool) -> None:
    """Ask unless ``yes``; without a yes nothing is done, and the exit status is 1."""
    if yes:
        return
    try:
        typer.confirm(question, abort=True, err=True)
    except typer.Abort as error:
        if isinstance(error.__context__, EOFError):
            raise DriverError("the question has no answer, so nothing was done: answer it at a terminal") from None
        raise
