"""Read a recording into arrays. The recording of a killed program is incomplete but can still be read."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from hal.types import FloatArray
from servoloop.recording.mcap import RecordingError
from servoloop.recording.mcap_messages import (
    COMMANDS,
    CYCLES,
    RESULT,
    STATES,
    STATUSES,
    OpenFile,
    Received,
    open_file,
    read_messages,
)

ERROR: Final = 2
"""Error level in diagnostic_msgs/DiagnosticStatus."""
BACK_S: Final = 1.0
"""Maximum backward step between the stamps of different publishers, in seconds. A larger backward step means that the
clock was reset."""


@dataclass(slots=True)
class RecordedRun:
    """Values of a run, as arrays (n,) or (n, joints).

    Units are rad and rad/s, or m and m/s. Times are in seconds since the first cycle. Joints are matched by name in
    each message. Values missing from a message are interpolated in time, or NaN before the joint's first value.
    """

    joints: tuple[str, ...] = ()
    begin_s: float = 0.0
    """ROS time of the first cycle."""
    time_s: FloatArray = field(default_factory=lambda: np.empty(0))
    """Times of the cycles, strictly increasing."""
    position: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    velocity: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    effort: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    command: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    """Commanded positions after the safety gate. NaN is used for joints without a command."""
    cycle_s: FloatArray = field(default_factory=lambda: np.empty(0))
    late_s: FloatArray = field(default_factory=lambda: np.empty(0))
    busy_s: FloatArray = field(default_factory=lambda: np.empty(0))
    missed: int = 0
    faults: list[tuple[str, float, float]] = field(default_factory=list)
    """Errors in the diagnostics, each with its start time and end time."""
    results: list[tuple[float, str]] = field(default_factory=list)
    """End time and result of each goal."""


def read_recording(path: Path, open_file: OpenFile = open_file) -> RecordedRun:
    """Read a recording that was made by servoloop or another program. The file may be incomplete. Raises
    RecordingError."""
    received: dict[str, list[Received]] = {}
    command_rows: list[int] = []
    for one in read_messages(path, open_file):
        received.setdefault(one.topic, []).append(one)
        if one.topic == COMMANDS:
            command_rows.append(len(received.get(STATES, ())) - 1)
    states = [one for one in received.get(STATES, []) if len(one.message.position)]
    if not states:
        raise RecordingError(f"{path} has no positions in {STATES}: the file is not a recording of a robot")
    return _Numbers(received, command_rows).run


class _Numbers:
    """Converter of a run's messages to arrays."""

    def __init__(self, received: dict[str, list[Received]], command_rows: Sequence[int]) -> None:
        """``command_rows`` contains the index of the joint state for each command."""
        self._received = received
        self._states = received[STATES]
        self._stamped = _are_stamped(self._states)
        times_s = self._times_s(STATES)
        order = np.argsort(times_s, kind="stable")
        sorted_s = times_s[order]
        # If several rows have the same time, the last row is kept.
        self._rows = order[np.append(np.diff(sorted_s) > 0.0, True)]
        self._time_s = times_s[self._rows]
        self._begin_s = float(self._time_s[0])
        joints = tuple(dict.fromkeys(name for one in self._states for name in one.message.name))
        cycles = received.get(CYCLES, [])
        self.run = RecordedRun(
            joints,
            self._begin_s,
            self._time_s - self._begin_s,
            position=self._column(joints, "position"),
            velocity=self._column(joints, "velocity"),
            effort=self._column(joints, "effort"),
            command=self._commands(joints, command_rows),
            cycle_s=self._times_s(CYCLES) - self._begin_s,
            late_s=np.array([one.message.late_s for one in cycles]),
            busy_s=np.array([one.message.busy_s for one in cycles]),
            missed=int(cycles[-1].message.missed) if cycles else 0,
            faults=list(self._faults()),
            results=list(self._results()),
        )

    def _times_s(self, topic: str) -> FloatArray:
        """Return the ROS times (n,) of a topic's messages: the header stamps if usable, otherwise the log times."""
        found = self._received.get(topic, [])
        return np.array([self._time_of(one) for one in found], dtype=np.float64)

    def _time_of(self, one: Received) -> float:
        return stamp_s(one.message) if self._stamped else one.stamp_ns * 1e-9

    def _column(self, joints: Sequence[str], kind: str) -> FloatArray:
        """Return one type of measurement for all joints, with shape (n, joints)."""
        table: FloatArray = _by_name([one.message for one in self._states], joints, kind)[self._rows]
        for column in table.T:
            known = np.isfinite(column)
            if known.any() and not known.all():
                inside = np.arange(len(column)) >= int(np.argmax(known))
                column[inside] = np.interp(self._time_s[inside], self._time_s[known], column[known])
        return table

    def _commands(self, joints: Sequence[str], rows: Sequence[int]) -> FloatArray:
        commands = [one.message for one in self._received.get(COMMANDS, [])]
        found: FloatArray = np.full((len(self._states), len(joints)), np.nan)
        found[rows] = _by_name(commands, joints, "position")
        found = found[self._rows]
        return found

    def _faults(self) -> Iterator[tuple[str, float, float]]:
        begun: dict[str, float] = {}
        for one in self._received.get(STATUSES, []):
            now_s, statuses = self._time_of(one) - self._begin_s, one.message.status
            wrong = {each.name.partition(": ")[2] or each.name for each in statuses if _level(each.level) >= ERROR}
            for name in [name for name in begun if name not in wrong]:
                yield name, begun.pop(name), now_s
            for name in wrong:
                begun.setdefault(name, now_s)
        for name, since_s in begun.items():
            yield name, since_s, float(self._time_s[-1]) - self._begin_s

    def _results(self) -> Iterator[tuple[float, str]]:
        for topic, received in self._received.items():
            if topic.endswith(RESULT):
                controller = topic.removesuffix(RESULT).strip("/")
                for one in received:
                    text = f"{controller}: {one.message.status} {one.message.error_string}".strip()
                    yield self._time_of(one) - self._begin_s, text


def _are_stamped(states: Iterable[Received]) -> bool:
    """Return whether the header stamps are usable: nonzero, not all equal, and not from a clock that was reset."""
    stamps = np.array([stamp_s(one.message) for one in states])
    back_s = np.maximum.accumulate(stamps) - stamps
    return bool(stamps.all() and back_s.max() < BACK_S and (len(stamps) == 1 or np.ptp(stamps) > 0.0))


def _by_name(messages: Sequence[Any], joints: Sequence[str], kind: str) -> FloatArray:
    """Return an array with one row per JointState and one column per joint. Missing and infinite values are returned as
    NaN."""
    places = {name: place for place, name in enumerate(joints)}
    found = np.full((len(messages), len(joints)), np.nan)
    for row, message in zip(found, messages, strict=True):
        for name, value in zip(message.name, getattr(message, kind).tolist(), strict=False):
            if name in places and math.isfinite(value):
                row[places[name]] = value
    return found


def _level(level: Any) -> int:
    return level[0] if isinstance(level, bytes) else int(level)


def stamp_s(message: Any) -> float:
    """Return the time in a message's header, in seconds."""
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
