"""Encode and write samples in a separate thread, so that the loop thread never waits for the disk."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Final, Protocol

from controller.manager.requests import Request
from drivers.driver_errors import DriverError
from drivers.printable import counted
from hal.types import JointState
from servoloop.recording.bus_tap import BusTaps, Transfer
from servoloop.recording.mcap import McapFile, RecordingError
from servoloop.recording.message_types import definition, typestore
from servoloop.recording.messages import Messages, Recorded
from servoloop.recording.sampler import CycleSample, Sampler, Scene, scene_poses

LOG = logging.getLogger("servoloop")
FLUSH_S: Final = 0.5
"""Period at which samples are written, in seconds.

If the program is killed, at most one period of data is lost. A longer period uses less CPU time.
"""
CLOSE_S: Final = 5.0
"""Maximum time to wait for the disk when the program exits, in seconds."""
WAITING: Final = 2_000
"""Maximum number of cycles queued for a slow disk: 100 s at 20 Hz."""


class Sink(Protocol):
    """Destination of samples.

    The recorder thread calls all methods except ``close``, which is called after this thread has ended.
    """

    @property
    def eager(self) -> bool:
        """Whether the sink needs each cycle immediately, followed by a flush."""
        ...

    @property
    def complete(self) -> bool:
        """Whether the sink is meant to contain every cycle, so that missing cycles must be reported."""
        ...

    def write(self, sample: CycleSample) -> None: ...
    def flush(self) -> None:
        """Process the samples that have been written so far. The recorder calls this when no more samples are
        available."""
        ...

    def close(self, transfers: Sequence[Transfer], failed: bool) -> None:
        """Write the bus traffic after the last cycle, and close the sink.

        ``failed`` indicates whether the loop ended with an error.
        """
        ...


class Recorder:
    """Recorder that passes each cycle to all sinks. A sink that fails is removed; the other sinks continue."""

    def __init__(self, sampler: Sampler, taps: BusTaps, sinks: Sequence[Sink], scene: Scene = dict) -> None:
        self.dropped = 0
        """Number of cycles missing from the recordings because the disk was too slow."""
        self._sampler, self._taps, self._scene = sampler, taps, scene
        self._sinks = list(sinks)
        self._removals: deque[Request[None]] = deque()
        self._waiting: deque[CycleSample] = deque()
        self._ended = False
        self._wake = threading.Event()
        self._eager = False
        self._flushed_s = 0.0
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)

    def start(self) -> None:
        """Start the recorder thread."""
        self._thread.start()

    def post(self, state: JointState) -> None:
        """Queue the cycle that measured this state. The loop thread calls this method, which never blocks."""
        sample = self._sampler.sample(state)
        if len(self._waiting) >= WAITING:
            self.dropped += any(sink.complete for sink in self._sinks)
        else:
            self._waiting.append(sample)
            if self._eager:
                self._wake.set()

    def add(self, sink: Sink) -> None:
        """Pass all subsequent cycles to an additional sink. Any thread may call this method."""
        self._sinks.append(sink)

    def remove(self, sink: Sink) -> Request[None]:
        """Request that the recorder thread close a sink after it has processed the cycles queued so far.

        Any thread may call this method.

        Returns:
            The request. The request's result raises RecordingError if the sink has failed.
        """
        request = Request(lambda: self._close(sink))
        self._removals.append(request)
        self._wake.set()
        return request

    def close(self, failed: bool) -> None:
        """Write all remaining samples and close the sinks. Call this after the last cycle of the loop.

        ``failed`` states whether the loop ended with an error.
        """
        self._ended = True
        self._wake.set()
        self._thread.join(CLOSE_S)
        if self._thread.is_alive():
            LOG.error("the disk did not respond for %.0f s: the end of the recordings is missing", CLOSE_S)
            return
        self.drain()
        transfers = self._taps.take()
        self._each(lambda sink: sink.close(transfers, failed))
        if self.dropped:
            LOG.warning("the recordings lack %s, because the disk was too slow", counted(self.dropped, "cycle"))

    def drain(self) -> None:
        """Pass all queued samples to the sinks."""
        samples = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if samples:  # The current scene applies only to the latest sample.
            samples[-1] = replace(samples[-1], scene=scene_poses(self._scene))

        now_s = monotonic()
        due = now_s - self._flushed_s >= FLUSH_S
        if due:
            self._flushed_s = now_s

        def write(sink: Sink) -> None:
            for sample in samples:
                sink.write(sample)
            if due or sink.eager:
                sink.flush()

        if samples:
            self._each(write)
        while self._removals:
            self._removals.popleft().serve()
        self._eager = any(sink.eager for sink in self._sinks)

    def _close(self, sink: Sink) -> None:
        if sink not in self._sinks:
            raise RecordingError("the recording has stopped because of an error: see the stack's log")
        self._sinks.remove(sink)
        sink.close((), failed=False)

    def _work(self) -> None:
        while not self._ended:
            self._wake.wait(FLUSH_S)
            self._wake.clear()
            self.drain()

    def _each(self, work: Callable[[Sink], None]) -> None:
        for sink in list(self._sinks):
            try:
                work(sink)
            except DriverError as error:
                LOG.error("recording stopped: %s", error)
                self._sinks.remove(sink)
            except Exception:  # a bug in one sink must not stop the loop or the other sinks
                LOG.exception("recording stopped after an internal error")
                self._sinks.remove(sink)


class RecordingFile:
    """Sink that writes one MCAP file."""

    eager = False
    complete = True

    def __init__(self, path: Path, messages: Messages) -> None:
        """Create the file. Raises RecordingError if the file cannot be created or already exists."""
        self.path = path
        self._messages = messages
        self._last_s: float | None = None
        """Time of the last cycle, in seconds."""
        self._encode = typestore().serialize_cdr
        self._file = McapFile(path)

    def write(self, sample: CycleSample) -> None:
        """Write one cycle. Raises RecordingError."""
        if self._last_s is None:
            self._write(self._messages.latched(sample.state.stamp_s))
        self._last_s = sample.state.stamp_s
        self._write(self._messages.of_cycle(sample))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record. Raises RecordingError."""
        self._file.add_metadata(name, values)

    def flush(self) -> None:
        """Hand all messages to the operating system, so that they are written even if this program is killed.

        Raises RecordingError.
        """
        self._file.flush()

    def close(self, transfers: Sequence[Transfer] = (), failed: bool = False) -> None:
        """Write the bus traffic since the last cycle and the index, and close the file. If the loop ended with an
        error, also write a fault. Raises RecordingError."""
        self._write(self._messages.of_transfers(transfers))
        if failed and self._last_s is not None:
            self._write([self._messages.of_failure(self._last_s)])
        self._file.close()

    def _write(self, messages: Iterable[Recorded]) -> None:
        for topic, kind, stamp_ns, message in messages:
            if not self._file.has_channel(topic):
                self._file.add_channel(topic, kind, definition(kind))
            self._file.add_message(topic, stamp_ns, bytes(self._encode(message, kind)))
