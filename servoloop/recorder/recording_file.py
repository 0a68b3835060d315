"""A recording's file: MCAP with ROS 2 messages, in small chunks, so that what a killed program leaves can be read."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Final

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import Writer

from servoloop.recorder.bus_tap import Transfer
from servoloop.recorder.definitions import definition, typestore
from servoloop.recorder.messages import Messages, Recorded
from servoloop.recorder.record_option import RecordingError
from servoloop.recorder.sampler import CycleSample

CHUNK: Final = 256 * 1024
"""Bytes after which a chunk ends though nobody asks for it; a cycle has some five thousand."""


class RecordingFile:
    """One file. ``close`` ends it; a file that was not closed lacks its index, and has all that was flushed."""

    def __init__(self, path: Path, messages: Messages) -> None:
        """Raises RecordingError where the file cannot be made, or is there already."""
        self.path = path
        self._messages = messages
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._encode = typestore().serialize_cdr
        try:
            self._stream: IO[bytes] = path.open("xb")
        except OSError as error:
            raise self._error(error) from error
        self._writer = Writer(self._stream, chunk_size=CHUNK)
        self._writer.start(profile=Profile.ROS2)

    def write(self, sample: CycleSample) -> None:
        """Write one cycle. Raises RecordingError."""
        if not self._channels:
            self._write(self._messages.latched(sample.state.stamp_s))
        self._write(self._messages.of_cycle(sample))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record. Raises RecordingError."""
        try:
            self._writer.add_metadata(name, dict(values))
        except OSError as error:
            raise self._error(error) from error

    def flush(self) -> None:
        """Hand all to the system: from here on it outlives this program. Raises RecordingError."""
        try:
            self._writer.flush()  # type: ignore[no-untyped-call]
        except OSError as error:
            raise self._error(error) from error

    def close(self, transfers: Sequence[Transfer] = (), failed: bool = False) -> None:
        """End the file with its index, behind the bus traffic since the last cycle. Raises RecordingError."""
        try:
            self._write(self._messages.of_transfers(transfers))
            with self._stream:
                self._writer.finish()  # type: ignore[no-untyped-call]
        except OSError as error:
            raise self._error(error) from error

    def _write(self, messages: Iterable[Recorded]) -> None:
        try:
            for topic, kind, stamp_ns, message in messages:
                channel = self._channels.get(topic) or self._channel(topic, kind)
                self._writer.add_message(channel, stamp_ns, bytes(self._encode(message, kind)), stamp_ns)
        except OSError as error:
            raise self._error(error) from error

    def _channel(self, topic: str, kind: str) -> int:
        if kind not in self._schemas:
            text = definition(kind).encode()
            self._schemas[kind] = self._writer.register_schema(kind, SchemaEncoding.ROS2, text)
        self._channels[topic] = self._writer.register_channel(topic, MessageEncoding.CDR, self._schemas[kind])
        return self._channels[topic]

    def _error(self, error: OSError) -> RecordingError:
        return RecordingError(f"cannot record into {self.path}: {error.strerror or error}")
