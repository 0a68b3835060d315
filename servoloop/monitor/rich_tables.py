"""The tables of who looks on, for a terminal."""

from typing import Final

from rich.table import Table as RichTable
from rich.text import Text

from servoloop.live.tables import Cell, Table

STYLES: Final = ("", "bold yellow", "bold red")
"""By the level of a cell."""


def rich_cell(cell: Cell) -> Text:
    """The text in the colour of its level."""
    return Text(cell.text, style=STYLES[min(cell.level, len(STYLES) - 1)])


def rich_table(table: Table) -> RichTable:
    """A table as wide as there is room."""
    found = RichTable(*table.head, box=None, expand=True, padding=(0, 1, 0, 0), header_style="bold cyan")
    for row in table.rows:
        found.add_row(*map(rich_cell, row))
    return found
