"""A recording that is played: any moment of it as a state."""

from bisect import bisect_left, bisect_right
from pathlib import Path

from servoloop.live.history import KEPT_S
from servoloop.live.watched import Watched
from servoloop.recorder.mcap_messages import STATES, Received, read_messages
from servoloop.recorder.record_option import RecordingError


class Recording:
    """The messages of a recording in their order, and the robot at the moment up to which it is played."""

    def __init__(self, path: Path) -> None:
        """Read the file, also one that was not ended. Raises RecordingError."""
        self.name = path.name
        self._entries = sorted(read_messages(path), key=lambda one: one.stamp_ns)
        self._stamps = [one.stamp_ns for one in self._entries]
        cycles = [one.stamp_ns for one in self._entries if one.topic == STATES]
        if not cycles:
            raise RecordingError(f"{path} has no {STATES}: it is no recording of a run")
        self._begin_ns = cycles[0]
        self.length_s = (cycles[-1] - cycles[0]) * 1e-9
        self.watched = Watched()
        self._next = 0
        self.play_to(0.0)

    def play_to(self, time_s: float) -> Watched:
        """Bring the robot to this time since the first cycle, forward or back, and return it."""
        stamp_ns = self._begin_ns + round(time_s * 1e9)
        until = bisect_right(self._stamps, stamp_ns)
        if until < self._next or stamp_ns - self._stamps[max(0, self._next - 1)] > KEPT_S * 1e9:
            self._jump(stamp_ns)
        for entry in self._entries[self._next : until]:
            self.watched.take(entry)
        self._next = until
        return self.watched

    def _jump(self, stamp_ns: int) -> None:
        """Begin anew a minute before a time, with what was said before and still holds then."""
        first = bisect_left(self._stamps, stamp_ns - round(KEPT_S * 1e9))
        latest: dict[str, Received] = {one.topic: one for one in self._entries[:first]}
        self.watched = Watched()
        for entry in sorted(latest.values(), key=lambda one: one.stamp_ns):
            self.watched.take(entry)
        self._next = first
