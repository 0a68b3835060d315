"""Print tables that fit into the terminal."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Column, Table


def print_table(console: "Console", table: "Table", *texts: str) -> None:
    """Print a table without truncating any text, even if the table is wider than the terminal.

    If the terminal is narrow, the columns ``texts`` are wrapped at words first. If that is not enough, empty columns
    are omitted, the space between the columns is reduced, and finally the other columns are wrapped. Words are broken
    only if the terminal is too narrow for the longest word of every column.

    Args:
        console: The terminal.
        table: The table.
        texts: Headings of the columns to wrap first.
    """
    table.show_edge = table.pad_edge = False
    if not _fits(console, table, texts):
        table.columns = [column for column in table.columns if any(map(str, column.cells))]
    for wrapped in (texts, texts, tuple(str(column.header) for column in table.columns)):
        if _fits(console, table, wrapped):
            break
        table.padding = (0, 0)
    for column, width in zip(table.columns, _widths(console, table, wrapped), strict=True):
        column.width, column.overflow, column.no_wrap = width, "fold", False
    console.print(table)


def _fits(console: "Console", table: "Table", texts: tuple[str, ...]) -> bool:
    """Return whether the table fits into the terminal if the columns ``texts`` are wrapped at words."""
    return sum(_least_widths(table, texts)) <= _room(console, table)


def _room(console: "Console", table: "Table") -> int:
    """Return the number of characters per line that are left for the contents of the columns."""
    return console.width - (len(table.columns) - 1) * (1 + table.padding[1] + table.padding[3])


def _least_widths(table: "Table", texts: tuple[str, ...]) -> list[int]:
    return [_longest(column, words=str(column.header) in texts) for column in table.columns]


def _longest(column: "Column", words: bool = False) -> int:
    """Return the length of the longest line or word in a column."""
    from rich.cells import cell_len

    lines = [line for cell in (column.header, *column.cells) for line in str(cell).splitlines()]
    return max((cell_len(part) for line in lines for part in (line.split() if words else [line])), default=1)


def _widths(console: "Console", table: "Table", texts: tuple[str, ...]) -> list[int]:
    """Return the widths of the columns. The widest columns are reduced first."""
    widths, least, room = list(map(_longest, table.columns)), _least_widths(table, texts), _room(console, table)
    if sum(least) > room:
        least = [1] * len(widths)
    while sum(widths) > room:
        spare = [width if width > floor else 0 for width, floor in zip(widths, least, strict=True)]
        if not any(spare):
            break
        widths[spare.index(max(spare))] -= 1
    return widths
