"""A running stack as a source: it waits for the stack to come back when it has ended."""

import threading
from bisect import bisect_left, bisect_right
from pathlib import Path
from typing import Final, Protocol

from drivers.clock import Clock
from servoloop.recording.history import KEPT_S
from servoloop.recording.mcap import RecordingError
from servoloop.recording.mcap_messages import STATES, Received, read_messages
from servoloop.recording.robot_state import Watched
from servoloop.recording.stream import LiveError, MessageStream, RunningStack, find_stack, open_live, running_stacks

AGAIN_S: Final = 1.0
"""So long until it looks again for a stack that has ended."""
SILENT_S: Final = 2.0
"""A stack that has given no cycle for so long is not called live."""


class LiveSource:
    """The newest state of a running stack; its thread reads the stack's feed."""

    def __init__(self, arm: str | None, clock: Clock) -> None:
        """``arm``: its name or folder, None for the only one that runs. Raises LiveError where none runs."""
        self._clock, self._heard_s = clock, clock.now()
        self._found = found = find_stack(arm)
        self.arm, self.folder = found.arm, found.folder
        self._ended = threading.Event()
        self._stream: MessageStream | None = None
        self.watched = Watched()
        self.connected = False
        self.has_state = threading.Event()
        """Set once a state of the robot has arrived."""
        self._thread = threading.Thread(target=self._read, name="live feed", daemon=True)
        self._thread.start()

    @property
    def status(self) -> str:
        """Whether the stack runs, and whether it gives cycles."""
        if not self.connected:
            return f"{self.arm}: the stack has ended. Waiting for it to come back"
        if not self.well:
            return f"{self.arm}: no cycle for {self.silent_s:.0f} s. The stack is paused, or it hangs"
        return f"{self.arm}: live"

    @property
    def well(self) -> bool:
        """Whether cycles come."""
        return self.connected and self.silent_s <= SILENT_S

    @property
    def silent_s(self) -> float:
        """So long ago the stack has given a cycle."""
        return self._clock.now() - self._heard_s

    @property
    def _same_arm(self) -> str:
        """What finds this arm again: its folder, because another arm's may have the same name."""
        return self.arm if self.folder is None else str(self.folder)

    def close(self) -> None:
        """End."""
        self._ended.set()
        if self._stream is not None:
            self._stream.close()
        self._thread.join(AGAIN_S)

    def _read(self) -> None:
        while not self._ended.is_set():
            try:
                self._stream = open_live(self._stack())
            except LiveError:
                self._ended.wait(AGAIN_S)
                continue
            try:
                self._follow(self._stream)
            finally:
                self.connected = False

    def _stack(self) -> RunningStack:
        """The stack of the beginning as long as it runs, then another one of its arm. Raises LiveError."""
        if self._found not in running_stacks():
            self._found = find_stack(self._same_arm)
        return self._found

    def _follow(self, stream: MessageStream) -> None:
        """Take all that a stack says until it ends."""
        watched = Watched()
        with stream:
            for received in stream:
                watched.take(received)
                self._heard_s = self._clock.now()
                if not self.connected and watched.state.snapshot.joints:
                    self.watched, self.connected = watched, True
                    self.has_state.set()


class Source(Protocol):
    """Where a robot's state comes from."""

    @property
    def watched(self) -> Watched:
        """The robot as it is now."""
        ...

    @property
    def status(self) -> str:
        """What is shown: a running stack, a recording, or that the stack has ended."""
        ...

    @property
    def well(self) -> bool:
        """Whether what is shown is what the status promises, and no state that has been left behind."""
        ...

    def close(self) -> None:
        """End."""
        ...


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


SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
"""Times the speed of the run."""


class Playback:
    """Plays a recording. One thread asks for ``watched``; any thread may seek, pause and change the speed."""

    well = True

    def __init__(self, recording: Recording, clock: Clock) -> None:
        self.playing = True
        self.speed = "1"
        """One of ``SPEEDS``."""
        self.time_s = 0.0
        """The moment that is shown, from the first cycle."""
        self.length_s = recording.length_s
        self.name = recording.name
        self._recording, self._clock = recording, clock
        self._asked_s: float | None = None
        self._last_s = clock.now()

    @property
    def status(self) -> str:
        """The recording's name, the moment, and how it is played."""
        speed = f"{self.speed} times the speed" if self.playing else "paused"
        return f"recording: {self.name}, {self.time_s:.1f} of {self.length_s:.1f} s, {speed}"

    @property
    def watched(self) -> Watched:
        """The robot at the moment that is played now."""
        self._advance()
        return self._recording.play_to(self.time_s)

    def seek(self, time_s: float) -> None:
        """Go to a moment; beyond an end of the recording that end is meant."""
        self._asked_s = min(max(time_s, 0.0), self.length_s)

    def toggle(self) -> None:
        """Pause, or play on."""
        self.playing = not self.playing

    def close(self) -> None:
        """Nothing is open."""

    def _advance(self) -> None:
        now_s = self._clock.now()
        passed_s, self._last_s = now_s - self._last_s, now_s
        asked_s, self._asked_s = self._asked_s, None
        if asked_s is not None:
            self.time_s = asked_s
        elif self.playing:
            self.time_s += passed_s * float(self.speed)
            if self.time_s > self.length_s:
                self.time_s = 0.0
