"""Screen of ``servoloop monitor``: joints, plots of the selected joint, faults, counters, the control loop, controllers
and goals."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Final

from rich.console import Group
from rich.padding import Padding
from rich.table import Table as RichTable
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.coordinate import Coordinate
from textual.widgets import DataTable, Footer, Static

from hal.robot_description.description import UrdfJoint, parse_urdf
from servoloop.dashboard.tables import (
    JOINT_COLUMNS,
    STRIPS,
    StateTable,
    TableCell,
    controller_table,
    counter_table,
    fault_table,
    joint_table,
    loop_table,
    result_table,
)
from servoloop.dashboard.terminal_chart import StripChart
from servoloop.recording.robot_state import ObservedRobot, RobotSnapshot
from servoloop.recording.sources import SPEEDS, Playback, Source

STYLES: Final = ("", "bold yellow", "bold red")
"""Text style for each level of a cell."""


def rich_cell(cell: TableCell) -> Text:
    """Return the text of a cell, colored by its level."""
    return Text(cell.text, style=STYLES[min(cell.level, len(STYLES) - 1)])


def rich_table(table: StateTable) -> RichTable:
    """Return a table that fills the available width."""
    found = RichTable(*table.head, box=None, expand=True, padding=(0, 1, 0, 0), header_style="bold cyan")
    for row in table.rows:
        found.add_row(*map(rich_cell, row))
    return found


WIDE: Final = 100
"""Minimum width of a terminal in which all columns of the joint table are shown, in characters."""
WIDE_ONLY: Final = ("command", "velocity")
"""Columns of the joint table that a narrower terminal omits."""


class JointsTable(DataTable[Text]):
    """Table of all joints in the latest snapshot."""

    def __init__(self) -> None:
        super().__init__(id="joints", cursor_type="row", cursor_foreground_priority="renderable")
        self._columns: tuple[str, ...] = ()
        self._joints: tuple[str, ...] = ()
        self._cells: tuple[tuple[TableCell, ...], ...] = ()
        self._xml = ""
        self._described: Mapping[str, UrdfJoint] = {}

    def on_mount(self) -> None:
        """Add the columns that fit into the terminal."""
        narrow = self.app.size.width < WIDE
        self._columns = tuple(column for column in JOINT_COLUMNS if not (narrow and column in WIDE_ONLY))
        self.add_columns("joint", *self._columns)

    def show(self, snapshot: RobotSnapshot) -> None:
        """Update the cells that have changed."""
        if snapshot.description_xml != self._xml:
            self._xml = snapshot.description_xml
            self._described = parse_urdf(self._xml).joints
        rows = joint_table(snapshot, self._described, self._columns).rows
        if snapshot.joints != self._joints:
            self._joints = snapshot.joints
            self.clear()
            for row in rows:
                self.add_row(*(self._text(cell, column) for column, cell in enumerate(row)))
        else:
            for place, (before, row) in enumerate(zip(self._cells, rows, strict=True)):
                self._renew(place, before, row)
        self._cells = rows

    def _renew(self, place: int, before: Sequence[TableCell], row: Sequence[TableCell]) -> None:
        """Update the changed cells of a row. A column width is recomputed only if the length of a text in the column
        changes."""
        for column, (old, new) in enumerate(zip(before, row, strict=True)):
            if new != old:
                wider = len(new.text) != len(old.text)
                self.update_cell_at(Coordinate(place, column), self._text(new, column), update_width=wider)

    def _text(self, cell: TableCell, column: int) -> Text:
        text = rich_cell(cell)
        if 0 < column < len(self._columns):  # numbers
            text.justify = "right"
        return text


JOINTS_S: Final = 0.25
"""Interval at which the joint table is updated, in seconds."""
ALL: Final = 4
"""Number of joint table updates between updates of the whole screen, which take longer."""
END_S: Final = 0.1
"""Interval at which ``stop`` is called, in seconds."""
SEEK_S: Final = 1.0
"""Time by which the arrow keys shift the playback, in seconds."""
KEYS: Final = {"p": "position", "e": "error", "v": "velocity", "l": "load", "u": "voltage", "t": "temperature"}
"""Keys that show or hide the plots, in the order of ``STRIPS``."""
AT_FIRST: Final = ("p", "e", "l")
"""Keys of the plots that are initially visible."""
OF_RECORDINGS: Final = ("pause", "seek", "speed")
"""Actions that are available only for recordings."""


class MonitorApp(App[None]):
    """Screen that displays one source. The screen only displays the arm. None of the keys moves the arm."""

    TITLE = "servoloop monitor"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #status { height: 1; text-style: bold; padding: 0 1; background: $primary-muted; }
    #status.unwell { background: $error; }
    #faults { height: auto; max-height: 5; padding: 0 1; }
    #joints { height: auto; max-height: 50%; }
    #strips { width: 3fr; }
    .strip { height: 1fr; min-height: 3; padding: 0 1; }
    #scroll { width: 2fr; padding-left: 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", "quit", priority=True),
        Binding("ctrl+c", "quit", show=False, priority=True),
        *(Binding(key, f"strip({place})", name) for place, (key, name) in enumerate(KEYS.items())),
        *(Binding(str(number), f"joint({number - 1})", show=False) for number in range(1, 10)),
        Binding("space", "pause", "pause", priority=True),
        Binding("left", f"seek({-SEEK_S})", "back", priority=True),
        Binding("right", f"seek({SEEK_S})", "forward", priority=True),
        Binding("minus", "speed(-1)", "slower"),
        Binding("plus", "speed(1)", "faster"),
    ]

    def __init__(self, source: Source, stop: Callable[[], bool] = lambda: False) -> None:
        """Create the screen. The screen closes when ``stop`` returns True."""
        super().__init__()
        self._source, self._stop = source, stop
        self._watched: ObservedRobot | None = None
        self._turn = 0
        self._shown_faults: StateTable | None = None
        self._joints = JointsTable()
        self._charts = [StripChart(strip) for strip in STRIPS]
        self._status, self._faults, self._tables = Static(id="status", markup=False), Static(id="faults"), Static()

    def compose(self) -> ComposeResult:
        """Arrange the widgets."""
        yield self._status
        yield self._faults
        yield self._joints
        with Horizontal():
            yield Vertical(*self._charts, id="strips")
            yield VerticalScroll(self._tables, id="scroll")
        yield Footer()

    def on_mount(self) -> None:
        """Start the updates."""
        for key, chart in zip(KEYS, self._charts, strict=True):
            chart.display = key in AT_FIRST
        self.set_interval(JOINTS_S, self._update)
        self.set_interval(END_S, self._end_if_asked)
        self.call_after_refresh(self.show)

    def show(self) -> None:
        """Update the whole screen."""
        snapshot = self._show_joints()
        self._draw()
        tables = (loop_table(snapshot), controller_table(snapshot), counter_table(snapshot), result_table(snapshot))
        self._tables.update(Group(*(Padding(rich_table(table), (0, 0, 1, 0)) for table in tables if table.rows)))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether an action is available. Playback actions are not available for a running stack."""
        return action not in OF_RECORDINGS or isinstance(self._source, Playback)

    def action_strip(self, place: int) -> None:
        """Show or hide a plot."""
        self._charts[place].display = not self._charts[place].display
        self.call_after_refresh(self._draw)

    def action_joint(self, place: int) -> None:
        """Select a joint."""
        self._joints.move_cursor(row=place)

    def on_data_table_row_highlighted(self) -> None:
        """Draw the plots of the newly selected joint."""
        self._draw()

    def on_resize(self) -> None:
        """Redraw the plots at the new size."""
        self.call_after_refresh(self._draw)

    def action_pause(self) -> None:
        """Pause or resume the playback."""
        self._playback.toggle()

    def action_seek(self, seconds: float) -> None:
        """Skip forward or back in the playback."""
        self._playback.seek(self._playback.time_s + seconds)
        self.show()

    def action_speed(self, steps: int) -> None:
        """Speed up or slow down the playback."""
        place = SPEEDS.index(self._playback.speed) + steps
        self._playback.speed = SPEEDS[min(max(place, 0), len(SPEEDS) - 1)]

    @property
    def _playback(self) -> Playback:
        assert isinstance(self._source, Playback)
        return self._source

    def _update(self) -> None:
        self._turn += 1
        if self._turn % ALL:
            self._show_joints()
        else:
            self.show()

    def _show_joints(self) -> RobotSnapshot:
        """Update the status line, the faults and the joint table."""
        self._watched = self._source.robot
        snapshot = self._watched.state.snapshot
        self._joints.show(snapshot)
        self._status.update(self._source.status, layout=False)
        self._status.set_class(not self._source.up_to_date, "unwell")
        faults = fault_table(snapshot)
        if faults != self._shown_faults:
            self._shown_faults, self._faults.display = faults, bool(faults.rows)
            self._faults.update(rich_table(faults))
        return snapshot

    def _draw(self) -> None:
        """Draw the plots of the selected joint."""
        if self._watched is None or not self._joints.row_count:
            return
        minute = self._watched.minute()
        for chart in self._charts:
            if chart.display:
                chart.show(minute, self._joints.cursor_row)

    def _end_if_asked(self) -> None:
        if self._stop():
            self.exit()
