"""A recording that is played: any moment of it as a state."""

import struct
from bisect import bisect_left, bisect_right
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

from servoloop.recorder.definitions import typestore
from servoloop.recorder.reader import COMMANDS, CYCLES, DIAGNOSTICS, RESULT, STATES
from servoloop.recorder.record_option import RecordingError
from servoloop.view.state import DESCRIPTION, GOAL, HISTORY_S, RobotState


class Entry(NamedTuple):
    """One message of a recording."""

    stamp_ns: int
    topic: str
    message: Any


class Recording:
    """The messages of a recording in their order, and the state at the moment up to which it is played."""

    def __init__(self, path: Path) -> None:
        """Read the file, also one that was not ended. Raises RecordingError."""
        self._entries = sorted(_entries(path), key=lambda entry: entry.stamp_ns)
        self._stamps = [entry.stamp_ns for entry in self._entries]
        states = [entry.stamp_ns for entry in self._entries if entry.topic == STATES]
        if not states:
            raise RecordingError(f"{path} has no {STATES}: it is no recording of a run")
        self._begin_ns = states[0]
        self.length_s = (states[-1] - states[0]) * 1e-9
        self.state = RobotState()
        self._next = 0
        self.play_to(0.0)

    def play_to(self, time_s: float) -> RobotState:
        """Bring the state to this time since the first cycle, forward or back, and return it."""
        stamp_ns = self._begin_ns + round(time_s * 1e9)
        until = bisect_right(self._stamps, stamp_ns)
        if until < self._next or stamp_ns - self._stamps[max(0, self._next - 1)] > HISTORY_S * 1e9:
            self._jump(stamp_ns)
        for place in range(self._next, until):
            self._take(place)
        self._next = until
        return self.state

    def _jump(self, stamp_ns: int) -> None:
        """Begin anew a minute before a time, with what was said before and still holds then."""
        first = bisect_left(self._stamps, stamp_ns - round(HISTORY_S * 1e9))
        self.state = RobotState()
        latest = {entry.topic: place for place, entry in enumerate(self._entries[:first])}
        for place in sorted(latest.values()):
            if self._entries[place].topic.endswith(GOAL):  # its path begins where the arm was then
                self._take(next(at for at in range(place, -1, -1) if self._entries[at].topic == STATES))
            self._take(place)
        self._next = first

    def _take(self, place: int) -> None:
        entry = self._entries[place]
        self.state.take(entry.topic, entry.stamp_ns, entry.message)


def _entries(path: Path) -> list[Entry]:
    wanted = (STATES, COMMANDS, CYCLES, DIAGNOSTICS, DESCRIPTION)
    decode = typestore().deserialize_cdr
    found: list[Entry] = []
    try:
        with path.open("rb") as stream:
            try:
                for schema, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                    if schema is not None and (channel.topic in wanted or channel.topic.endswith((GOAL, RESULT))):
                        content = decode(message.data, schema.name)
                        found.append(Entry(message.log_time, channel.topic, content))
            except (McapError, struct.error) as error:
                if stream.tell() < 8:  # not even the magic bytes
                    raise RecordingError(f"{path} is no MCAP file: {error}") from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    return found
