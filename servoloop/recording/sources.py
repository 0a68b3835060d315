"""Sources of a robot's state for dashboards: a running stack, or a recording that is played back."""

import threading
from bisect import bisect_left, bisect_right
from pathlib import Path
from typing import Final, Protocol

from drivers.clock import Clock
from servoloop.recording.history import KEPT_S
from servoloop.recording.mcap import RecordingError
from servoloop.recording.mcap_messages import STATES, Received, read_messages
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.stream import LiveError, MessageStream, RunningStack, find_stack, open_live, running_stacks

AGAIN_S: Final = 1.0
"""Time between attempts to reconnect to a stack, in seconds."""
SILENT_S: Final = 2.0
"""Maximum time since the last cycle at which a stack counts as live, in seconds."""


class LiveSource:
    """Latest state of a running stack. A thread reads the stack's feed and reconnects when the stack restarts."""

    def __init__(self, arm: str | None, clock: Clock, namespace: str | None = None) -> None:
        """Connect to a stack.

        Args:
            arm: Name, folder or process ID of the arm, or None for any arm.
            clock: Clock that measures the time since the last message.
            namespace: ROS namespace of the stack; empty for the root namespace, None for any namespace.

        Raises:
            LiveError: No stack of this arm is running, or several are running.
        """
        self._clock, self._heard_s = clock, clock.now()
        self._found = found = find_stack(arm, namespace)
        self.arm, self.folder = found.name, found.folder
        self._ended = threading.Event()
        self._stream: MessageStream | None = None
        self.robot = ObservedRobot()
        self.connected = False
        self.has_state = threading.Event()
        """Event that is set after the first state of the robot has arrived."""
        self._thread = threading.Thread(target=self._read, name="live feed", daemon=True)
        self._thread.start()

    @property
    def stack(self) -> RunningStack:
        """Stack that the source is connected to, or the last stack that it was connected to."""
        return self._found

    @property
    def status(self) -> str:
        """Name of the arm, with a note that states whether its stack is running and sending cycles."""
        if not self.connected:
            return f"{self.arm}: the stack has stopped. Waiting for it to restart"
        if not self.up_to_date:
            return f"{self.arm}: no cycle for {self.silent_s:.0f} s. The stack is paused or hangs"
        return f"{self.arm}: live"

    @property
    def up_to_date(self) -> bool:
        """Whether the stack is connected and sending cycles."""
        return self.connected and self.silent_s <= SILENT_S

    @property
    def silent_s(self) -> float:
        """Time since the last message from the stack, in seconds."""
        return self._clock.now() - self._heard_s

    @property
    def _same_arm(self) -> str:
        """Folder of this arm, or its name. The folder is preferred, because another arm may have the same name."""
        return self._found.arm if self.folder is None else str(self.folder)

    def close(self) -> None:
        """Disconnect and end the thread."""
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
        """Return the current stack. If the stack is no longer running, find a new stack of the same arm. Raises
        LiveError."""
        if self._found not in running_stacks():
            self._found = find_stack(self._same_arm, self._found.namespace)
        return self._found

    def _follow(self, stream: MessageStream) -> None:
        """Process the messages of a stack until it ends."""
        robot = ObservedRobot()
        with stream:
            for received in stream:
                robot.take(received)
                self._heard_s = self._clock.now()
                if not self.connected and robot.state.snapshot.joints:
                    self.robot, self.connected = robot, True
                    self.has_state.set()


class Source(Protocol):
    """Source of a robot's state."""

    @property
    def robot(self) -> ObservedRobot:
        """Robot with its current state."""
        ...

    @property
    def status(self) -> str:
        """Description of the source, such as a running stack, a stopped stack or a recording."""
        ...

    @property
    def up_to_date(self) -> bool:
        """Whether the state is up to date. False if the stack has stopped or is hanging."""
        ...

    def close(self) -> None:
        """Close the source."""
        ...


class PlayedRecording:
    """Messages of a recording in order, and the robot at the current playback position."""

    def __init__(self, path: Path) -> None:
        """Read the file, which may be incomplete. Raises RecordingError."""
        self.name = path.name
        self._entries = sorted(read_messages(path), key=lambda one: one.stamp_ns)
        self._stamps = [one.stamp_ns for one in self._entries]
        cycles = [one.stamp_ns for one in self._entries if one.topic == STATES]
        if not cycles:
            raise RecordingError(f"{path} has no {STATES}: the file is not a recording of a robot")
        self._begin_ns = cycles[0]
        self.length_s = (cycles[-1] - cycles[0]) * 1e-9
        self.robot = ObservedRobot()
        self._next = 0
        self.play_to(0.0)

    def play_to(self, time_s: float) -> ObservedRobot:
        """Return the robot at ``time_s`` seconds after the first cycle. Playback can also move backward."""
        stamp_ns = self._begin_ns + round(time_s * 1e9)
        until = bisect_right(self._stamps, stamp_ns)
        if until < self._next or stamp_ns - self._stamps[max(0, self._next - 1)] > KEPT_S * 1e9:
            self._jump(stamp_ns)
        for entry in self._entries[self._next : until]:
            self.robot.take(entry)
        self._next = until
        return self.robot

    def _jump(self, stamp_ns: int) -> None:
        """Restart one minute before a given time, with the last earlier message of each topic."""
        first = bisect_left(self._stamps, stamp_ns - round(KEPT_S * 1e9))
        latest: dict[str, Received] = {one.topic: one for one in self._entries[:first]}
        self.robot = ObservedRobot()
        for entry in sorted(latest.values(), key=lambda one: one.stamp_ns):
            self.robot.take(entry)
        self._next = first


SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
"""Playback speeds, as multiples of the original speed."""


class Playback:
    """Playback of a recording. One thread reads ``robot``; any thread may seek, pause and change the speed."""

    up_to_date = True

    def __init__(self, recording: PlayedRecording, clock: Clock) -> None:
        self.playing = True
        self.speed = "1"
        """Playback speed, one of ``SPEEDS``."""
        self.time_s = 0.0
        """Playback position, in seconds since the first cycle."""
        self.length_s = recording.length_s
        self.name = recording.name
        self._recording, self._clock = recording, clock
        self._seek_s: float | None = None
        self._last_s = clock.now()

    @property
    def status(self) -> str:
        """Name of the recording, playback position and speed."""
        speed = f"{self.speed} times the original speed" if self.playing else "paused"
        return f"recording: {self.name}, {self.time_s:.1f} of {self.length_s:.1f} s, {speed}"

    @property
    def robot(self) -> ObservedRobot:
        """Robot at the current playback position."""
        self._advance()
        return self._recording.play_to(self.time_s)

    def seek(self, time_s: float) -> None:
        """Seek to a time, limited to the length of the recording."""
        self._seek_s = min(max(time_s, 0.0), self.length_s)

    def toggle(self) -> None:
        """Pause or resume."""
        self.playing = not self.playing

    def close(self) -> None:
        """Do nothing, because no file is open."""

    def _advance(self) -> None:
        now_s = self._clock.now()
        passed_s, self._last_s = now_s - self._last_s, now_s
        seek_s, self._seek_s = self._seek_s, None
        if seek_s is not None:
            self.time_s = seek_s
        elif self.playing:
            self.time_s += passed_s * float(self.speed)
            if self.time_s > self.length_s:
                self.time_s = 0.0
