"""The texts of the page: the tables of who looks on, in HTML."""

from collections.abc import Mapping
from html import escape
from typing import Final

from hal.robot_description.description import UrdfJoint
from servoloop.live import tables
from servoloop.live.robot_state import Snapshot
from servoloop.live.tables import Cell, Table

STYLE: Final = 'style="width:100%;font-size:0.78em;border-collapse:collapse;text-align:left"'
ROW: Final = 'style="border-bottom:1px solid #8884"'
COLUMNS: Final = ("position", "error", "temp.", "supply", "state")
"""Of a joint; the others are the strips'."""


def servo_table(snapshot: Snapshot, joints: Mapping[str, UrdfJoint]) -> str:
    """A row for each joint: position, error, temperature, voltage, and what is wrong with it."""
    return html(tables.joint_table(snapshot, joints, COLUMNS))


def faults(snapshot: Snapshot) -> str:
    """What is wrong or gives a warning, by name; empty where all is well."""
    rows = tables.fault_table(snapshot).rows
    return "".join(f"<p>{_cell(name)}: {_cell(message)}</p>" for name, message in rows)


def loop_table(snapshot: Snapshot) -> str:
    """The loop's timing: the newest cycle, and what its diagnostics have counted."""
    return html(tables.loop_table(snapshot))


def counter_table(snapshot: Snapshot) -> str:
    """What went wrong on the line, counted by servo and by port."""
    return html(tables.counter_table(snapshot))


def controller_table(snapshot: Snapshot) -> str:
    """Components and controllers with their states, each controller's newest goal, and how goals ended."""
    results = tables.result_table(snapshot)
    return html(tables.controller_table(snapshot)) + (html(results) if results.rows else "")


def html(table: Table) -> str:
    """A table in HTML; what is in its cells is text and no markup."""
    lines = [f"<th>{'</th><th>'.join(map(escape, table.head))}</th>"]
    lines += [f"<td>{'</td><td>'.join(map(_cell, row))}</td>" for row in table.rows]
    return f"<table {STYLE}><tr {ROW}>{f'</tr><tr {ROW}>'.join(lines)}</tr></table>"


def _cell(cell: Cell) -> str:
    text = escape(cell.text)
    return f'<b style="color:#d2322d">{text}</b>' if cell.level else text
