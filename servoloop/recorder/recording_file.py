"""A recording's file: MCAP with ROS 2 messages, in small chunks, so that what a killed program leaves can be read."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO

from servoloop.recorder.bus_tap import Transfer
from servoloop.recorder.definitions import definition, typestore
from servoloop.recorder.mcap_stream import McapStream
from servoloop.recorder.messages import Messages, Recorded
from servoloop.recorder.record_option import RecordingError
from servoloop.recorder.sampler import CycleSample


class RecordingFile:
    """One file. ``close`` ends it; a file that was not closed lacks its index, and has all that was flushed."""

    eager = False

    def __init__(self, path: Path, messages: Messages) -> None:
        """Raises RecordingError where the file cannot be made, or is there already."""
        self.path = path
        self._messages = messages
        self._begun = False
        self._encode = typestore().serialize_cdr
        try:
            self._stream: IO[bytes] = path.open("xb")
        except OSError as error:
            raise self._error(error) from error
        self._mcap = McapStream(self._stream, chunked=True)

    def write(self, sample: CycleSample) -> None:
        """Write one cycle. Raises RecordingError."""
        if not self._begun:
            self._begun = True
            self._write(self._messages.latched(sample.state.stamp_s))
        self._write(self._messages.of_cycle(sample))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record. Raises RecordingError."""
        try:
            self._mcap.add_metadata(name, values)
        except OSError as error:
            raise self._error(error) from error

    def flush(self) -> None:
        """Hand all to the system: from here on it outlives this program. Raises RecordingError."""
        try:
            self._mcap.flush()
        except OSError as error:
            raise self._error(error) from error

    def close(self, transfers: Sequence[Transfer] = (), failed: bool = False) -> None:
        """End the file with its index, behind the bus traffic since the last cycle. Raises RecordingError."""
        try:
            self._write(self._messages.of_transfers(transfers))
            with self._stream:
                self._mcap.finish()
        except OSError as error:
            raise self._error(error) from error

    def _write(self, messages: Iterable[Recorded]) -> None:
        try:
            for topic, kind, stamp_ns, message in messages:
                if not self._mcap.knows(topic):
                    self._mcap.add_channel(topic, kind, definition(kind))
                self._mcap.add_message(topic, stamp_ns, bytes(self._encode(message, kind)))
        except OSError as error:
            raise self._error(error) from error

    def _error(self, error: OSError) -> RecordingError:
        return RecordingError(f"cannot record into {self.path}: {error.strerror or error}")
