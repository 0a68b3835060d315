"""The tables of those who look on: joints, what is wrong, counters, the loop, components and controllers, goals."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from controller.diagnostics import CONTROLLERS, LOOP
from hal.robot_description.description import UrdfJoint
from hal.types import FloatArray
from servoloop.recording.robot_state import (
    OF_SERVO,
    OWN,
    Health,
    Minute,
    Snapshot,
    StatusNow,
    health,
    health_column,
    servo_status,
)

PORT: Final = "noise"
"""A counter that only ports have."""
HEALTH: Final = ("voltage_v", "temperature_c", "current_a", "replies", "alarms")
"""Values of a servo that are no counters of what goes wrong."""
JOINT_COLUMNS: Final = ("position", "command", "error", "velocity", "load", "temp.", "supply", "state")
NEWEST: Final = 5
"""So many ends of goals are shown."""


class Cell(NamedTuple):
    """A text; its level is that of diagnostic_msgs/DiagnosticStatus: 0 is well, 1 a warning, 2 an error."""

    text: str
    level: int = 0


class Table(NamedTuple):
    """A table; each row has as many cells as the head."""

    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


def joint_table(snapshot: Snapshot, joints: Mapping[str, UrdfJoint], columns: Sequence[str] = JOINT_COLUMNS) -> Table:
    """A row for each joint with its name and these columns of ``JOINT_COLUMNS``; ``joints``: of the description."""
    said, rows = health(snapshot), []
    for place, name in enumerate(snapshot.joints):
        linear = name in joints and joints[name].kind == "prismatic"
        scale, unit = (1e3, "mm") if linear else (math.degrees(1.0), "°")
        cells = {
            "position": Cell(number(snapshot.position[place] * scale, 1, unit)),
            "command": Cell(number(snapshot.command[place] * scale, 1, unit)),
            "error": Cell(number(snapshot.error[place] * scale, 2, unit)),
            "velocity": Cell(number(snapshot.velocity[place] * scale, 1, f"{unit}/s")),
            "load": Cell(number(snapshot.effort[place], 2, "N" if linear else "N m")),
            "temp.": Cell(number(said.temperature_c[place], 0, "°C")),
            "supply": Cell(number(said.voltage_v[place], 1, "V")),
            "state": _message(servo_status(snapshot, name)),
        }
        rows.append((Cell(name), *(cells[column] for column in columns)))
    return Table(("joint", *columns), tuple(rows))


def fault_table(snapshot: Snapshot) -> Table:
    """The names of all that is wrong or gives a warning, with what is said of it; no rows where all is well."""
    wrong = ((name, one) for name, one in snapshot.statuses.items() if one.level >= 1)
    return Table(("", "what is wrong"), tuple((Cell(name.removeprefix(OWN)), _message(one)) for name, one in wrong))


def loop_table(snapshot: Snapshot) -> Table:
    """The loop's timing: the newest cycle, and what its diagnostics have counted."""
    rows = [
        ("woke up late by", number(snapshot.late_s * 1e3, 2, "ms")),
        ("busy for", number(snapshot.busy_s * 1e3, 2, "ms")),
        ("missed cycles", str(snapshot.missed)),
    ]
    if snapshot.lost_cycles:
        rows.append(("not seen by this program", str(snapshot.lost_cycles)))
    loop = snapshot.statuses.get(LOOP)
    if loop is not None:
        counted = {key: value for key, value in loop.values.items() if key != "missed_cycles"}
        rows += [(key.replace("_", " "), value) for key, value in counted.items()]
    return Table(("control loop", ""), _plain(rows))


def counter_table(snapshot: Snapshot) -> Table:
    """The counters of what went wrong on the line, by servo and by port."""
    return Table(("servo or port", "counted"), _plain(_counted(snapshot)))


def controller_table(snapshot: Snapshot) -> Table:
    """Components and controllers with their states, and each controller's newest goal."""
    rows: list[tuple[Cell, ...]] = [
        (Cell(name.removeprefix(OWN)), _message(one))
        for name, one in snapshot.statuses.items()
        if OF_SERVO not in name and name not in (LOOP, CONTROLLERS) and PORT not in one.values
    ]
    controllers = snapshot.statuses.get(CONTROLLERS)
    rows += _plain(controllers.values.items() if controllers else ())
    rows += _plain((f"{name}: newest goal", goal.ended or "under way") for name, goal in snapshot.goals.items())
    return Table(("component or controller", "state"), tuple(rows))


def result_table(snapshot: Snapshot) -> Table:
    """The newest ends of goals, the last one first, and how long ago each was."""
    newest = reversed(snapshot.results[-NEWEST:])
    rows = ((number(snapshot.stamp_s - stamp_s, 0, "s ago"), text) for stamp_s, text in newest)
    return Table(("goal ended", "how"), _plain(rows))


def number(value: float, places: int, unit: str) -> str:
    """A number with its unit, a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:.{places}f}\u00a0{unit}"


def _plain(rows: Iterable[tuple[str, str]]) -> tuple[tuple[Cell, ...], ...]:
    return tuple((Cell(name), Cell(text)) for name, text in rows)


def _counted(snapshot: Snapshot) -> Iterator[tuple[str, str]]:
    for name, one in snapshot.statuses.items():
        if OF_SERVO in name or PORT in one.values:
            counted = {key: value for key, value in one.values.items() if key not in HEALTH and value != "0"}
            yield name.removeprefix(OWN), ", ".join(f"{key} {value}" for key, value in counted.items()) or "nothing"


def _message(status: StatusNow | None) -> Cell:
    return Cell("") if status is None else Cell(status.message, status.level)


MOST: Final = 600
"""Points in a strip; of more every so many-th is shown."""


class Strip(NamedTuple):
    """A plot: its title, and the numbers in it."""

    title: str
    columns: tuple[str, ...]
    least: float
    """The smallest range of its axis: what is less is noise."""


STRIPS: Final = (
    Strip("position, command (rad, m)", ("position", "command"), 0.02),
    Strip("error (rad, m)", ("error",), 0.002),
    Strip("velocity (1/s)", ("velocity",), 0.1),
    Strip("load (N m, N)", ("effort",), 0.5),
    Strip("voltage (V)", ("voltage_v",), 2.0),
    Strip("temperature (°C)", ("temperature_c",), 10.0),
)


def strip_data(minute: Minute, columns: Sequence[str], place: int) -> tuple[FloatArray, ...]:
    """Seconds before the newest cycle, and for each column its numbers of the joint at ``place``."""
    curves, rows = minute
    if columns[0] in Health._fields:
        times = np.array([row.stamp_s for row in rows])
        values = [health_column(rows, name, place) for name in columns]
    else:
        times, values = curves.time_s, [_column(getattr(curves, name), place) for name in columns]
    if not len(times):
        return tuple(np.zeros(1) for _ in range(len(columns) + 1))
    step = -(-len(times) // MOST)
    now = max([*curves.time_s[-1:], times[-1]])
    return times[::step] - now, *(column[::step] for column in values)


def axis_range(columns: Sequence[FloatArray], least: float) -> tuple[float, float]:
    """The range of an axis: all numbers that are there, at least ``least``, in steps so that it seldom changes."""
    values = np.concatenate(columns)
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    step = 2.0 ** math.ceil(math.log2(max(high - low, least) / 4.0))
    return math.floor(low / step - 0.25) * step, math.ceil(high / step + 0.25) * step


def _column(values: FloatArray, place: int) -> FloatArray:
    """A column of (m, n), none where nothing has been measured."""
    return values[:, place] if values.size else np.empty(0)
