"""A recording's file: each cycle as ROS 2 messages."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from servoloop.recorder.bus_tap import Transfer
from servoloop.recorder.definitions import definition, typestore
from servoloop.recorder.mcap_file import McapFile
from servoloop.recorder.messages import Messages, Recorded
from servoloop.recorder.sampler import CycleSample


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
