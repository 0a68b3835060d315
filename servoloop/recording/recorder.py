"""The recorder's thread: the loop's thread hands it samples and never waits; it encodes and writes them."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Final, Protocol

from drivers.errors import DriverError
from drivers.printable import counted
from hal.types import JointState
from servoloop.recording.bus_tap import BusTaps, Transfer
from servoloop.recording.mcap import McapFile
from servoloop.recording.message_types import definition, typestore
from servoloop.recording.messages import Messages, Recorded
from servoloop.recording.sampler import CycleSample, Sampler, Scene, scene_poses

LOG = logging.getLogger("servoloop")
FLUSH_S: Final = 0.5
"""So much of a recording is lost at the most when the program is killed; woken less often, writing costs less."""
CLOSE_S: Final = 5.0
"""So long a program that ends waits for its disk."""
WAITING: Final = 2_000
"""So many cycles wait for a disk that is slow: 100 s at 20 Hz."""


class Sink(Protocol):
    """A place to which samples go. All calls come from the recorder's thread, ``close`` behind its end."""

    @property
    def eager(self) -> bool:
        """Whether it is to be given each cycle at once, and flushed with it."""
        ...

    def write(self, sample: CycleSample) -> None: ...
    def flush(self) -> None:
        """Some samples have been written, and there are no more for the moment."""
        ...

    def close(self, transfers: Sequence[Transfer], failed: bool) -> None:
        """End, with the bus traffic behind the last cycle. ``failed``: the loop has ended by an error."""
        ...


class Recorder:
    """The recorder gives each cycle to all sinks. A sink that fails is given up, and the others go on."""

    def __init__(self, sampler: Sampler, taps: BusTaps, sinks: Sequence[Sink], scene: Scene = dict) -> None:
        self.dropped = 0
        """Cycles that are in no recording, because the disk was too slow."""
        self._sampler, self._taps, self._scene = sampler, taps, scene
        self._sinks = list(sinks)
        self._waiting: deque[CycleSample] = deque()
        self._ended = False
        self._wake = threading.Event()
        self._eager = False
        self._flushed_s = 0.0
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)

    def start(self) -> None:
        """Begin to write."""
        self._thread.start()

    def post(self, state: JointState) -> None:
        """Take the cycle that has measured this state. In the loop's thread; it never waits."""
        sample = self._sampler.sample(state)
        if len(self._waiting) >= WAITING:
            self.dropped += 1
        else:
            self._waiting.append(sample)
            if self._eager:  # now there is time until the next cycle
                self._wake.set()

    def close(self, failed: bool) -> None:
        """Write what is left, and end. ``failed``: the loop has ended by an error. Behind the loop's last cycle."""
        self._ended = True
        self._wake.set()
        self._thread.join(CLOSE_S)
        if self._thread.is_alive():
            LOG.error("the disk has taken nothing for %.0f s: the end of the recordings is missing", CLOSE_S)
            return
        self.drain()
        transfers = self._taps.take()
        self._each(lambda sink: sink.close(transfers, failed))
        if self.dropped:
            LOG.warning("%s missing from the recordings: the disk was too slow", counted(self.dropped, "cycle"))

    def drain(self) -> None:
        """Give the sinks all that waits."""
        samples = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if samples:  # the scene as it is now: of the cycles before nobody has looked
            samples[-1] = replace(samples[-1], scene=scene_poses(self._scene))

        now_s = monotonic()
        due = now_s - self._flushed_s >= FLUSH_S
        if due:
            self._flushed_s = now_s

        def give(sink: Sink) -> None:
            for sample in samples:
                sink.write(sample)
            if due or sink.eager:
                sink.flush()

        if samples:
            self._each(give)
        self._eager = any(sink.eager for sink in self._sinks)

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
                LOG.error("the recording ends here: %s", error)
                self._sinks.remove(sink)
            except Exception:  # a defect: the loop and the other sinks go on
                LOG.exception("the recording ends here")
                self._sinks.remove(sink)


class RecordingFile:
    """One file, as McapFile."""

    eager = False

    def __init__(self, path: Path, messages: Messages) -> None:
        """Raises RecordingError where the file cannot be made, or is there already."""
        self.path = path
        self._messages = messages
        self._begun = False
        self._encode = typestore().serialize_cdr
        self._file = McapFile(path)

    def write(self, sample: CycleSample) -> None:
        """Write one cycle. Raises RecordingError."""
        if not self._begun:
            self._begun = True
            self._write(self._messages.latched(sample.state.stamp_s))
        self._write(self._messages.of_cycle(sample))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record. Raises RecordingError."""
        self._file.add_metadata(name, values)

    def flush(self) -> None:
        """Hand all to the system: from here on it outlives this program. Raises RecordingError."""
        self._file.flush()

    def close(self, transfers: Sequence[Transfer] = (), failed: bool = False) -> None:
        """End the file with its index, behind the bus traffic since the last cycle. Raises RecordingError."""
        self._write(self._messages.of_transfers(transfers))
        self._file.close()

    def _write(self, messages: Iterable[Recorded]) -> None:
        for topic, kind, stamp_ns, message in messages:
            if not self._file.knows(topic):
                self._file.add_channel(topic, kind, definition(kind))
            self._file.add_message(topic, stamp_ns, bytes(self._encode(message, kind)))
