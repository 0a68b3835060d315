"""The texts of the page: tables of servos, of counters and of the loop, in HTML."""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Final

from hal.description import UrdfJoint
from servoloop.view.state import OWN, Diagnostic, RobotState

LOOP: Final = "control loop"
CONTROLLER: Final = "controller "
STYLE: Final = 'style="width:100%;font-size:0.78em;border-collapse:collapse;text-align:left"'
ROW: Final = 'style="border-bottom:1px solid #8884"'
HEALTH: Final = ("voltage_v", "temperature_c", "current_a", "replies")
"""Values of a servo that are no counters of what goes wrong."""


def servo_table(state: RobotState, joints: Mapping[str, UrdfJoint]) -> str:
    """A row for each joint: position, error, temperature, voltage, and what is wrong with it."""
    newest = state.newest
    if newest is None:
        return "nothing measured yet"
    rows = []
    for place, name in enumerate(state.joints):
        linear = name in joints and joints[name].kind == "prismatic"
        scale, unit = (1e3, "mm") if linear else (math.degrees(1.0), "°")
        one = state.of_joint(name)
        rows.append(
            (
                name,
                number(newest.position[place] * scale, 1, unit),
                number(newest.error[place] * scale, 2, unit),
                number(newest.temperature_c[place], 0, "°C"),
                number(newest.voltage_v[place], 1, "V"),
                "" if one is None else f"<b>{escape(one.message)}</b>" if one.level else escape(one.message),
            )
        )
    return table(("joint", "position", "error", "temp.", "supply", "state"), rows)


def faults(state: RobotState) -> str:
    """What is wrong, by name; empty where nothing is."""
    wrong = [one for one in state.diagnostics if one.level >= 1]
    return "".join(f"<p><b>{escape(_name(one))}</b>: {escape(one.message)}</p>" for one in wrong)


def loop_text(state: RobotState) -> str:
    """The loop's timing: the newest cycle, and what its diagnostics have counted."""
    rows = [
        ("woke up late by", number(state.late_s * 1e3, 2, "ms")),
        ("busy for", number(state.busy_s * 1e3, 2, "ms")),
        ("missed cycles", str(state.missed)),
    ]
    loop = next((one for one in state.diagnostics if _name(one) == LOOP), None)
    if loop is not None:
        rows += [(key.replace("_", " "), value) for key, value in loop.values.items() if key != "missed_cycles"]
    return table(("control loop", ""), rows)


def counters(state: RobotState) -> str:
    """What went wrong on the line, counted by servo and by port; zeros are left out."""
    return table(("servo or port", "counted"), list(_counted(state)))


def controllers(state: RobotState) -> str:
    """Components and controllers with their states, and each trajectory controller's newest goal."""
    rows = []
    for one in state.diagnostics:
        name = _name(one)
        if one.joint is None and name != LOOP and not one.values:
            rows.append((escape(name.removeprefix(CONTROLLER)), escape(one.message)))
    rows += [(f"{escape(name)}: newest goal", escape(goal.end or "under way")) for name, goal in state.goals.items()]
    return table(("component or controller", "state"), rows)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in HTML. The cells are HTML already."""
    lines = [f"<th>{'</th><th>'.join(head)}</th>", *(f"<td>{'</td><td>'.join(row)}</td>" for row in rows)]
    return f"<table {STYLE}><tr {ROW}>{f'</tr><tr {ROW}>'.join(lines)}</tr></table>"


def number(value: float, places: int, unit: str) -> str:
    """A number with its unit, a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:.{places}f} {unit}"


def _counted(state: RobotState) -> Iterator[tuple[str, str]]:
    for one in state.diagnostics:
        if one.joint is None and "noise" not in one.values:
            continue
        found = [
            f"{key} {value}" for key, value in one.values.items() if key not in HEALTH and value not in ("0", "0.0")
        ]
        yield escape(_name(one)), escape(", ".join(found)) or "nothing"


def _name(one: Diagnostic) -> str:
    return one.name.removeprefix(OWN)
