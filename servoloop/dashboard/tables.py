"""Tables and plot data of ``view`` and ``monitor``: joints, faults, counters, control loop, controllers and goals."""

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
    RobotSnapshot,
    StatusNow,
    health,
    health_column,
    servo_status,
)

PORT: Final = "noise"
"""Key of a counter that exists only for ports."""
HEALTH: Final = ("voltage_v", "temperature_c", "current_a", "replies", "alarms")
"""Keys in a servo's status that are not error counters."""
JOINT_COLUMNS: Final = ("position", "command", "error", "velocity", "load", "temp.", "supply", "state")
NEWEST: Final = 5
"""Maximum number of goal results shown."""


class TableCell(NamedTuple):
    """Text with a level as in diagnostic_msgs/DiagnosticStatus: 0 is OK, 1 is a warning and 2 is an error."""

    text: str
    level: int = 0


class StateTable(NamedTuple):
    """Table in which each row has as many cells as the header."""

    head: tuple[str, ...]
    rows: tuple[tuple[TableCell, ...], ...]


def joint_table(
    snapshot: RobotSnapshot, joints: Mapping[str, UrdfJoint], columns: Sequence[str] = JOINT_COLUMNS
) -> StateTable:
    """Return a table with a row for each joint.

    Args:
        snapshot: State of the robot.
        joints: Joints of the robot description, keyed by name.
        columns: Columns of ``JOINT_COLUMNS`` to include, after the joint's name.
    """
    servo_health, rows = health(snapshot), []
    for place, name in enumerate(snapshot.joints):
        linear = name in joints and joints[name].kind == "prismatic"
        scale, unit = (1e3, "mm") if linear else (math.degrees(1.0), "°")
        cells = {
            "position": TableCell(number(snapshot.position[place] * scale, 1, unit)),
            "command": TableCell(number(snapshot.command[place] * scale, 1, unit)),
            "error": TableCell(number(snapshot.error[place] * scale, 2, unit)),
            "velocity": TableCell(number(snapshot.velocity[place] * scale, 1, f"{unit}/s")),
            "load": TableCell(number(snapshot.effort[place], 2, "N" if linear else "N m")),
            "temp.": TableCell(number(servo_health.temperature_c[place], 0, "°C")),
            "supply": TableCell(number(servo_health.voltage_v[place], 1, "V")),
            "state": _message(servo_status(snapshot, name)),
        }
        rows.append((TableCell(name), *(cells[column] for column in columns)))
    return StateTable(("joint", *columns), tuple(rows))


def fault_table(snapshot: RobotSnapshot) -> StateTable:
    """Return a table of all errors and warnings."""
    faults = ((name, one) for name, one in snapshot.statuses.items() if one.level >= 1)
    return StateTable(("", "faults"), tuple((TableCell(name.removeprefix(OWN)), _message(one)) for name, one in faults))


def loop_table(snapshot: RobotSnapshot) -> StateTable:
    """Return a table of the latest cycle's timing and the control loop's diagnostics."""
    rows = [
        ("start delay", number(snapshot.late_s * 1e3, 2, "ms")),
        ("duration", number(snapshot.busy_s * 1e3, 2, "ms")),
        ("missed cycles", str(snapshot.missed)),
    ]
    if snapshot.lost_cycles:
        rows.append(("cycles not shown here", str(snapshot.lost_cycles)))
    loop = snapshot.statuses.get(LOOP)
    if loop is not None:
        counted = {key: value for key, value in loop.values.items() if key != "missed_cycles"}
        rows += [(key.replace("_", " "), value) for key, value in counted.items()]
    return StateTable(("control loop", ""), _plain(rows))


def counter_table(snapshot: RobotSnapshot) -> StateTable:
    """Return a table of the communication errors of each servo and port."""
    return StateTable(("servo or port", "errors"), _plain(_counted(snapshot)))


def controller_table(snapshot: RobotSnapshot) -> StateTable:
    """Return a table of the states of components and controllers, including the latest goal of each controller."""
    rows: list[tuple[TableCell, ...]] = [
        (TableCell(name.removeprefix(OWN)), _message(one))
        for name, one in snapshot.statuses.items()
        if OF_SERVO not in name and name not in (LOOP, CONTROLLERS) and PORT not in one.values
    ]
    controllers = snapshot.statuses.get(CONTROLLERS)
    rows += _plain(controllers.values.items() if controllers else ())
    rows += _plain((f"{name}: latest goal", goal.ended or "active") for name, goal in snapshot.goals.items())
    return StateTable(("component or controller", "state"), tuple(rows))


def result_table(snapshot: RobotSnapshot) -> StateTable:
    """Return a table of the latest goal results, most recent first, with their age."""
    newest = reversed(snapshot.results[-NEWEST:])
    rows = ((number(snapshot.stamp_s - stamp_s, 0, "s ago"), text) for stamp_s, text in newest)
    return StateTable(("goal ended", "result"), _plain(rows))


def number(value: float, places: int, unit: str) -> str:
    """Return a number with its unit, or a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:.{places}f}\u00a0{unit}"


def _plain(rows: Iterable[tuple[str, str]]) -> tuple[tuple[TableCell, ...], ...]:
    return tuple((TableCell(name), TableCell(text)) for name, text in rows)


def _counted(snapshot: RobotSnapshot) -> Iterator[tuple[str, str]]:
    for name, one in snapshot.statuses.items():
        if OF_SERVO in name or PORT in one.values:
            counted = {key: value for key, value in one.values.items() if key not in HEALTH and value != "0"}
            yield name.removeprefix(OWN), ", ".join(f"{key} {value}" for key, value in counted.items()) or "none"


def _message(status: StatusNow | None) -> TableCell:
    return TableCell("") if status is None else TableCell(status.message, status.level)


MOST: Final = 600
"""Maximum number of points in a plot. Longer data is decimated."""


class Strip(NamedTuple):
    """Plot of one joint over the last minute."""

    title: str
    columns: tuple[str, ...]
    least: float
    """Minimum range of the vertical axis, so that noise does not fill the plot."""


STRIPS: Final = (
    Strip("position, command (rad, m)", ("position", "command"), 0.02),
    Strip("error (rad, m)", ("error",), 0.002),
    Strip("velocity (1/s)", ("velocity",), 0.1),
    Strip("load (N m, N)", ("effort",), 0.5),
    Strip("voltage (V)", ("voltage_v",), 2.0),
    Strip("temperature (°C)", ("temperature_c",), 10.0),
)


def strip_data(minute: Minute, columns: Sequence[str], place: int) -> tuple[FloatArray, ...]:
    """Return the plot data for the joint with index ``place``.

    The first array contains the times relative to the latest cycle, in seconds. Each other array contains the values
    of one column.
    """
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
    """Return an axis range that contains all finite values and is at least ``least`` wide.

    The range is rounded, so it rarely changes.
    """
    values = np.concatenate(columns)
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    step = 2.0 ** math.ceil(math.log2(max(high - low, least) / 4.0))
    return math.floor(low / step - 0.25) * step, math.ceil(high / step + 0.25) * step


def _column(values: FloatArray, place: int) -> FloatArray:
    """Return a column of an array (m, n), or an empty array if nothing was measured."""
    return values[:, place] if values.size else np.empty(0)
