"""A reader of recordings: the numbers of a run as arrays, from a whole file or from what a killed program has left."""

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

from hal.types import FloatArray
from servoloop.recorder.definitions import typestore
from servoloop.recorder.record_option import RecordingError

STATES, COMMANDS, CYCLES = "/joint_states", "/servoloop/commands", "/servoloop/cycles"
DIAGNOSTICS = "/diagnostics"
RESULT: Final = "/goal_result"
ERROR: Final = 2
"""The level of diagnostic_msgs/DiagnosticStatus."""


@dataclass(slots=True)
class RecordedRun:
    """The numbers of a run; times in s since its first cycle, arrays (n,) or (n, joints), rad or m and per second."""

    joints: tuple[str, ...] = ()
    begin_s: float = 0.0
    """ROS time of the first cycle."""
    time_s: FloatArray = field(default_factory=lambda: np.empty(0))
    position: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    velocity: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    effort: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    command: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    """Positions that the safety gate let pass; NaN where none is commanded."""
    cycle_s: FloatArray = field(default_factory=lambda: np.empty(0))
    late_s: FloatArray = field(default_factory=lambda: np.empty(0))
    busy_s: FloatArray = field(default_factory=lambda: np.empty(0))
    missed: int = 0
    faults: list[tuple[str, float, float]] = field(default_factory=list)
    """What the diagnostics call an error, with its begin and end."""
    results: list[tuple[float, str]] = field(default_factory=list)
    """The ends of goals."""


def read_recording(path: Path) -> RecordedRun:
    """Read a recording of servoloop, also one that was not ended. Raises RecordingError."""
    messages: dict[str, list[Any]] = {}
    for topic, message in _messages(path):
        messages.setdefault(topic, []).append(message)
    states = messages.get(STATES, [])
    if not states:
        raise RecordingError(f"{path} has no {STATES}: it is no recording of a run")
    begin_s = _stamp_s(states[0])

    def times(topic: str) -> FloatArray:
        return np.array([_stamp_s(message) - begin_s for message in messages.get(topic, [])])

    def column(topic: str, name: str) -> FloatArray:
        return np.array([getattr(message, name) for message in messages.get(topic, [])])

    cycles = messages.get(CYCLES, [])
    return RecordedRun(
        tuple(states[0].name),
        begin_s,
        times(STATES),
        position=column(STATES, "position"),
        velocity=column(STATES, "velocity"),
        effort=column(STATES, "effort"),
        command=_commands(messages.get(COMMANDS, []), states[0].name, len(states)),
        cycle_s=times(CYCLES),
        late_s=column(CYCLES, "late_s"),
        busy_s=column(CYCLES, "busy_s"),
        missed=int(cycles[-1].missed) if cycles else 0,
        faults=list(_faults(messages.get(DIAGNOSTICS, []), begin_s, _stamp_s(states[-1]))),
        results=list(_results(messages, begin_s)),
    )


def _results(messages: Mapping[str, list[Any]], begin_s: float) -> Iterator[tuple[float, str]]:
    for topic in messages:
        if topic.endswith(RESULT):
            controller = topic.removesuffix(RESULT).strip("/")
            for one in messages[topic]:
                yield _stamp_s(one) - begin_s, f"{controller}: {one.status} {one.error_string}".strip()


def _messages(path: Path) -> Iterator[tuple[str, Any]]:
    """The messages that a run's numbers come from, in the order of the file, as far as it goes."""
    decode: Callable[[bytes, str], Any] = typestore().deserialize_cdr
    try:
        with path.open("rb") as stream:
            try:
                for schema, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                    wanted = channel.topic in (STATES, COMMANDS, CYCLES, DIAGNOSTICS) or channel.topic.endswith(RESULT)
                    if wanted and schema is not None:
                        yield channel.topic, decode(message.data, schema.name)
            except (McapError, struct.error) as error:
                if stream.tell() < 8:  # not even the magic bytes
                    raise RecordingError(f"{path} is no MCAP file: {error}") from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error


def _commands(messages: list[Any], joints: list[str], cycles: int) -> FloatArray:
    found = np.full((cycles, len(joints)), np.nan)
    for row, message in zip(found, messages, strict=False):
        for name, value in zip(message.name, message.position, strict=False):
            row[joints.index(name)] = value
    return found


def _faults(messages: list[Any], begin_s: float, end_s: float) -> Iterator[tuple[str, float, float]]:
    begun: dict[str, float] = {}
    for message in messages:
        now_s = _stamp_s(message) - begin_s
        wrong = {one.name.partition(": ")[2] or one.name for one in message.status if _level(one.level) >= ERROR}
        for name in [name for name in begun if name not in wrong]:
            yield name, begun.pop(name), now_s
        for name in wrong:
            begun.setdefault(name, now_s)
    for name, since_s in begun.items():
        yield name, since_s, end_s - begin_s


def _level(level: Any) -> int:
    return level[0] if isinstance(level, bytes) else int(level)


def _stamp_s(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
