"""Record a stack, either in its own process (``servoloop up``) or from its live feed (``servoloop record``)."""

import logging
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

from controller.loop import ControlLoop
from controller.manager.requests import Request
from drivers.clock import Clock
from drivers.port import Port
from hal.types import JointState
from servoloop.recording.bus_tap import BusTaps
from servoloop.recording.fault_files import FOLDER, FaultFiles
from servoloop.recording.feed import LiveFeed
from servoloop.recording.mcap import McapFile, RecordingError, check_path
from servoloop.recording.mcap_messages import GOAL, RESULT, STATES, Encoded, read_messages
from servoloop.recording.messages import Messages
from servoloop.recording.recorder import FLUSH_S, Recorder, RecordingFile, Sink
from servoloop.recording.sampler import Sampler, Scene
from servoloop.recording.stream import LiveError, MessageStream, make_live_folder, socket_path, stack_name
from servoloop.stack.robot_files import Files, servo_ids

LOG = logging.getLogger("servoloop")


class StackRecording:
    """Recordings of one stack: the file of ``--record``, fault files and the live feed.

    The bus taps exist before the loop, because the ports are opened first.
    """

    def __init__(self, path: Path | None) -> None:
        """Record to the file ``path``, or record only faults if ``path`` is None."""
        self._path = path
        self._taps = BusTaps()
        self._recorder: Recorder | None = None
        self._messages: Messages | None = None
        self._files: dict[Path, RecordingFile] = {}
        """Recordings that clients have started, keyed by path."""

    def begin(self, path: Path) -> None:
        """Start another recording. Raises RecordingError if the file cannot be created."""
        if self._recorder is None or self._messages is None:
            raise RecordingError("the stack cannot record, because its loop is not running")
        check_path(path)
        self._files[path] = file = RecordingFile(path, self._messages)
        self._recorder.add(file)

    def end(self, path: Path) -> Request[None]:
        """Request the end of a recording that was started with ``begin``.

        Raises RecordingError if there is no such recording.
        """
        file = self._files.pop(path, None)
        if file is None or self._recorder is None:
            begun = ", ".join(map(str, self._files)) or "none"
            raise RecordingError(f"no client has started a recording in {path}; recordings started by clients: {begun}")
        return self._recorder.remove(file)

    def tap(self, port: Port, clock: Clock) -> Port:
        """Return a port that records the traffic of ``port``."""
        return self._taps.tap(port, clock)

    @contextmanager
    def of(
        self,
        loop: ControlLoop,
        files: Files,
        offset_s: float,
        failed: Callable[[], bool],
        scene: Scene = dict,
        live: bool = True,
    ) -> Iterator[None]:
        """Record the loop while the context is open. The loop's previous ``on_cycle`` function is called first.

        Args:
            loop: Control loop.
            files: Files of the robot.
            offset_s: ROS time minus the time of the loop's clock, in seconds.
            failed: Function that returns whether the loop failed. It is called when the recording ends.
            scene: Function that returns the objects around the arm and is called in the recorder thread.
            live: Whether to write fault files and let other programs find the stack and receive its live feed.

        Raises:
            RecordingError: The recording cannot be created.
        """
        hardware, shown = loop.hardware, loop.on_cycle
        messages = Messages(files.description, hardware.joints, hardware.command_interfaces, offset_s)
        sinks: list[Sink] = [FaultFiles(FOLDER, messages)] if live else []
        if self._path is not None:
            sinks.append(RecordingFile(self._path, messages))
        sinks += _live_feed(files, messages) if live else []
        sampler = Sampler(loop, files.component.name, servo_ids(files), self._taps)
        recorder = self._recorder = Recorder(sampler, self._taps, sinks, scene)
        self._messages = messages

        def on_cycle(state: JointState) -> None:
            shown(state)
            recorder.post(state)

        loop.on_cycle = on_cycle
        recorder.start()
        try:
            yield
        finally:
            self._recorder = None
            recorder.close(failed())


def _live_feed(files: Files, messages: Messages) -> list[Sink]:
    """Return the live feed, or an empty list if the feed cannot be created. The arm also works without a live feed."""
    try:
        make_live_folder()
        path, name = socket_path(files.arm, os.getpid(), files.namespace), stack_name(files.arm, files.namespace)
        shortened = not path.name.startswith(f"{name}-")
        return [LiveFeed(path, messages, files.folder, name if shortened else "")]
    except LiveError as error:
        LOG.warning("%s", error)
        return []


POLL_S: Final = 0.1
"""Period at which the end of a recording is checked, in seconds."""


@dataclass(slots=True)
class RecordedCycles:
    """Statistics of a live recording."""

    cycles: int = 0
    length_s: float = 0.0
    """Time from the first to the last cycle, in seconds."""
    lost_cycles: int = 0
    """Number of cycles lost because this program was too slow."""
    stack_ended: bool = False


def record(stream: MessageStream, path: Path, seconds: float | None, stop: Callable[[], bool]) -> RecordedCycles:
    """Record a live stream to a new file.

    Args:
        stream: Messages of the stack.
        path: Path of the new file.
        seconds: Maximum length of the recording in seconds of the stack's time, or None for no limit.
        stop: Function that returns whether to end the recording.

    Raises:
        RecordingError: The file cannot be written, or no cycles arrived. After a write error, the file contains the
            earlier cycles; if it does not contain any cycles, it is deleted.
    """
    with stream:
        file = McapFile(path)
        try:
            recording = _LiveRecording(stream, file, seconds)
            recording.run(stop)
        except BaseException:
            if not _has_cycles(path):
                path.unlink()
            raise
    if not recording.recorded.cycles:
        path.unlink()
        raise RecordingError(
            "no cycles arrived, so nothing was recorded: check whether the stack is paused or its port hangs"
        )
    return recording.recorded


def _has_cycles(path: Path) -> bool:
    """Return whether a recording that could not be completed contains cycles, or cannot be read."""
    try:
        return path.stat().st_size > 0 and any(one.topic == STATES for one in read_messages(path))
    except RecordingError:
        return True


class _LiveRecording:
    """Recording of a live stream. One thread receives the messages; the caller of ``run`` flushes the file."""

    def __init__(self, stream: MessageStream, file: McapFile, seconds: float | None) -> None:
        self.recorded = RecordedCycles()
        self._stream, self._file = stream, file
        self._longest_ns = None if seconds is None else round(seconds * 1e9)
        self._begun_ns = 0
        self._sequence = 0
        self._stopped = False
        self._error: RecordingError | None = None
        self._file_lock = threading.Lock()

    def run(self, stop: Callable[[], bool]) -> None:
        """Record until the end and close the file. Raises RecordingError."""
        thread = threading.Thread(target=self._take_all, name="live feed", daemon=True)
        thread.start()
        polls = 0
        while thread.is_alive() and not stop():
            thread.join(POLL_S)
            polls += 1
            if polls % round(FLUSH_S / POLL_S) == 0:
                with self._file_lock:
                    self._file.flush()
        self._stopped = True  # the thread ends after a complete cycle
        thread.join(FLUSH_S)
        self._stream.close()  # This ends a thread that is still waiting for a cycle.
        thread.join()
        if self._error is not None:
            raise self._error
        self._file.close()

    def _take_all(self) -> None:
        try:
            for _, messages in groupby(self._stream.encoded(), key=lambda one: one[2].sequence):
                cycle = list(messages)  # A cycle is complete only when the next cycle starts.
                with self._file_lock:
                    if not self._count(cycle):
                        return
                    self._write(cycle)
                if self._stopped:
                    return
            self.recorded.stack_ended = not self._stopped
        except RecordingError as error:
            self._error = error

    def _count(self, cycle: Sequence[Encoded]) -> bool:
        """Count a cycle and return whether it is within the maximum length."""
        recorded = self.recorded
        for message in (message for _, channel, message in cycle if channel.topic == STATES):
            if recorded.cycles == 0:
                self._begun_ns, self._sequence = message.log_time, message.sequence - 1
            length_ns = message.log_time - self._begun_ns
            if self._longest_ns is not None and length_ns > self._longest_ns:
                return False
            recorded.lost_cycles += message.sequence - self._sequence - 1
            self._sequence = message.sequence
            recorded.cycles += 1
            recorded.length_s = length_ns * 1e-9
        return True

    def _write(self, cycle: Sequence[Encoded]) -> None:
        for schema, channel, message in cycle if self.recorded.cycles > 1 else _without_past_goals(cycle):
            if not self._file.has_channel(channel.topic):
                self._file.add_channel(channel.topic, schema.name, schema.data.decode())
            self._file.add_message(channel.topic, message.log_time, message.data)


def _without_past_goals(cycle: Sequence[Encoded]) -> list[Encoded]:
    """Return the messages of the first cycle, except for goals that ended before it. The feed sends such goals to every
    new viewer."""
    begun_ns = next((message.log_time for _, channel, message in cycle if channel.topic == STATES), 0)
    past = [channel.topic for _, channel, message in cycle if message.log_time < begun_ns]
    ended = {topic.removesuffix(RESULT) for topic in past if topic.endswith(RESULT)}
    over = {name + end for name in ended for end in (GOAL, RESULT)}
    return [one for one in cycle if one[1].topic not in over or one[2].log_time >= begun_ns]
