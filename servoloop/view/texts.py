"""The texts of the page: tables of servos, of counters and of the loop, in HTML."""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Final

from hal.robot_description.description import UrdfJoint
from servoloop.live.robot_state import Snapshot, StatusNow
from servoloop.live.servo_status import OF_SERVO, OWN, servo_status
from servoloop.view.watched import health

LOOP: Final = "control loop"
PORT: Final = "noise"
"""A counter that only ports have."""
STYLE: Final = 'style="width:100%;font-size:0.78em;border-collapse:collapse;text-align:left"'
ROW: Final = 'style="border-bottom:1px solid #8884"'
HEALTH: Final = ("voltage_v", "temperature_c", "current_a", "replies", "alarms")
"""Values of a servo that are no counters of what goes wrong."""


def servo_table(snapshot: Snapshot, joints: Mapping[str, UrdfJoint]) -> str:
    """A row for each joint: position, error, temperature, voltage, and what is wrong with it."""
    rows = []
    said = health(snapshot)
    for place, name in enumerate(snapshot.joints):
        linear = name in joints and joints[name].kind == "prismatic"
        scale, unit = (1e3, "mm") if linear else (math.degrees(1.0), "°")
        rows.append(
            (
                escape(name),
                number(snapshot.position[place] * scale, 1, unit),
                number(snapshot.error[place] * scale, 2, unit),
                number(said.temperature_c[place], 0, "°C"),
                number(said.voltage_v[place], 1, "V"),
                _message(servo_status(snapshot, name)),
            )
        )
    return table(("joint", "position", "error", "temp.", "supply", "state"), rows)


def faults(snapshot: Snapshot) -> str:
    """What is wrong or gives a warning, by name; empty where all is well."""
    wrong = [(name, one) for name, one in snapshot.statuses.items() if one.level >= 1]
    return "".join(f"<p>{escape(name.removeprefix(OWN))}: {_message(one)}</p>" for name, one in wrong)


def loop_table(snapshot: Snapshot) -> str:
    """The loop's timing: the newest cycle, and what its diagnostics have counted."""
    rows = [
        ("woke up late by", number(snapshot.late_s * 1e3, 2, "ms")),
        ("busy for", number(snapshot.busy_s * 1e3, 2, "ms")),
        ("missed cycles", str(snapshot.missed)),
    ]
    loop = snapshot.statuses.get(OWN + LOOP)
    if loop is not None:
        counted = {key: value for key, value in loop.values.items() if key != "missed_cycles"}
        rows += [(escape(key.replace("_", " ")), escape(value)) for key, value in counted.items()]
    return table(("control loop", ""), rows)


def counter_table(snapshot: Snapshot) -> str:
    """What went wrong on the line, counted by servo and by port."""
    return table(("servo or port", "counted"), list(_counted(snapshot)))


def controller_table(snapshot: Snapshot) -> str:
    """Components and controllers with their states, and each controller's newest goal."""
    rows = [
        (escape(name.removeprefix(OWN)), _message(one))
        for name, one in snapshot.statuses.items()
        if OF_SERVO not in name and name != OWN + LOOP and PORT not in one.values
    ]
    for name, goal in snapshot.goals.items():
        rows.append((f"{escape(name)}: newest goal", escape(goal.ended or "under way")))
    return table(("component or controller", "state"), rows)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in HTML. The cells are HTML already."""
    lines = [f"<th>{'</th><th>'.join(head)}</th>", *(f"<td>{'</td><td>'.join(row)}</td>" for row in rows)]
    return f"<table {STYLE}><tr {ROW}>{f'</tr><tr {ROW}>'.join(lines)}</tr></table>"


def number(value: float, places: int, unit: str) -> str:
    """A number with its unit, a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:.{places}f}\u00a0{unit}"


def _counted(snapshot: Snapshot) -> Iterator[tuple[str, str]]:
    for name, one in snapshot.statuses.items():
        if OF_SERVO in name or PORT in one.values:
            counted = {key: value for key, value in one.values.items() if key not in HEALTH and value != "0"}
            text = ", ".join(f"{key} {value}" for key, value in counted.items())
            yield escape(name.removeprefix(OWN)), escape(text or "nothing")


def _message(status: StatusNow | None) -> str:
    if status is None:
        return ""
    text = escape(status.message)
    return f'<b style="color:#d2322d">{text}</b>' if status.level else text
