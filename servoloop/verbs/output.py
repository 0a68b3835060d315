"""How tools print: one JSON document for programs, tables for people."""

import json
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from drivers.errors import DriverError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

UNLIMITED: Final = 1000
"""More columns than any table needs."""

JsonOption = Annotated[bool, typer.Option("--json", help="One JSON document instead of tables.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask.")]


def print_json(value: Any) -> None:
    """Print a dataclass, or a list or mapping of them."""
    typer.echo(json.dumps(value, default=_plain, indent=2))


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def print_table(console: "Console", table: "Table", *texts: str) -> None:
    """Print a table without cutting anything, also where it is wider than the terminal.

    Args:
        console: The terminal.
        table: The table.
        texts: The headings of the columns that are wrapped first; the others are wrapped in a narrow terminal only.
    """
    table.show_edge = table.pad_edge = False
    for column in table.columns:
        column.overflow = "fold"
        column.no_wrap = str(column.header) not in texts
    if console.measure(table, options=console.options.update(max_width=UNLIMITED)).minimum > console.width:
        for column in table.columns:
            column.no_wrap = False
    console.print(table)


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
