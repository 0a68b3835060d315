"""The joints in the terminal: a row for each, the chosen one under the cursor."""

from collections.abc import Mapping, Sequence

from rich.text import Text
from textual.coordinate import Coordinate
from textual.widgets import DataTable

from hal.robot_description.description import UrdfJoint, parse_urdf
from servoloop.live.robot_state import Snapshot
from servoloop.live.tables import JOINT_COLUMNS, Cell, joint_table
from servoloop.monitor.rich_tables import rich_cell


class JointsTable(DataTable[Text]):
    """All joints of the newest snapshot."""

    def __init__(self) -> None:
        super().__init__(id="joints", cursor_type="row", cursor_foreground_priority="renderable")
        self._joints: tuple[str, ...] = ()
        self._cells: tuple[tuple[Cell, ...], ...] = ()
        self._xml = ""
        self._described: Mapping[str, UrdfJoint] = {}

    def on_mount(self) -> None:
        """Name the columns."""
        self.add_columns("joint", *JOINT_COLUMNS)

    def show(self, snapshot: Snapshot) -> None:
        """Renew what has changed."""
        if snapshot.description_xml != self._xml:
            self._xml = snapshot.description_xml
            self._described = parse_urdf(self._xml).joints
        rows = joint_table(snapshot, self._described).rows
        if snapshot.joints != self._joints:
            self._joints = snapshot.joints
            self.clear()
            for row in rows:
                self.add_row(*(_text(cell, column) for column, cell in enumerate(row)))
        else:
            for place, (before, row) in enumerate(zip(self._cells, rows, strict=True)):
                self._renew(place, before, row)
        self._cells = rows

    def _renew(self, place: int, before: Sequence[Cell], row: Sequence[Cell]) -> None:
        """Write the cells that have changed; a column is measured anew only for a text of another length."""
        for column, (old, new) in enumerate(zip(before, row, strict=True)):
            if new != old:
                wider = len(new.text) != len(old.text)
                self.update_cell_at(Coordinate(place, column), _text(new, column), update_width=wider)


def _text(cell: Cell, column: int) -> Text:
    text = rich_cell(cell)
    if 0 < column < len(JOINT_COLUMNS):  # numbers
        text.justify = "right"
    return text
