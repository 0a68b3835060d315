"""A new MCAP file of encoded messages, in small chunks, so that what a killed program leaves can be read."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Annotated, Final

import typer
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

from drivers.errors import DriverError

CHUNK: Final = 256 * 1024
"""Bytes after which a chunk ends though nobody asks for it; a cycle has some five thousand."""


class McapStream:
    """Writes encoded ROS 2 messages; the channels and types of a stream are in it before the first message of each.

    OSError of the output goes through.
    """

    def __init__(self, output: IO[bytes], chunked: bool) -> None:
        """``chunked``: compressed and with an index at its end, as a file; else each message by itself, at once."""
        compression = CompressionType.ZSTD if chunked else CompressionType.NONE
        self._writer = Writer(output, CHUNK, compression, use_chunking=chunked)
        self._writer.start(profile=Profile.ROS2)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def knows(self, topic: str) -> bool:
        """Whether the topic has a channel."""
        return topic in self._channels

    def add_channel(self, topic: str, kind: str, definition: str) -> None:
        """Open the channel of a topic, whose messages are of this type, with the type's text."""
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, SchemaEncoding.ROS2, definition.encode())
        self._channels[topic] = self._writer.register_channel(topic, MessageEncoding.CDR, self._schemas[kind])

    def add_message(self, topic: str, stamp_ns: int, data: bytes, sequence: int = 0) -> None:
        """Write an encoded message of a topic that has a channel; ``stamp_ns`` is ROS time."""
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, sequence)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, dict(values))

    def flush(self) -> None:
        """Hand on all that is kept back."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """End the stream with its index."""
        self._writer.finish()  # type: ignore[no-untyped-call]


SUFFIX: Final = ".mcap"
"""Programs know the format by it."""
RecordOption = Annotated[
    Path | None, typer.Option("--record", metavar="FILE.mcap", help="Record every cycle and all bus traffic.")
]


class RecordingError(DriverError):
    """A recording cannot be written or read."""


def check_path(path: Path) -> None:
    """Check that a recording can begin there. Raises RecordingError."""
    if path.suffix != SUFFIX:
        raise RecordingError(f"a recording is a file whose name ends in {SUFFIX}, not {path}")
    if path.exists():
        raise RecordingError(f"{path} is there already: name another file, or delete it")
    if not path.parent.is_dir():
        raise RecordingError(f"there is no folder {path.parent} to record into: make it first")


class McapFile:
    """One file. ``close`` ends it; a file that was not closed lacks its index, and has all that was flushed.

    Every call raises RecordingError where the disk does not take it.
    """

    def __init__(self, path: Path) -> None:
        """Raises RecordingError where the file cannot be made, or is there already."""
        self.path = path
        with self._errors():
            self._stream: IO[bytes] = path.open("xb")
        self._mcap = McapStream(self._stream, chunked=True)
        self.knows = self._mcap.knows

    def add_channel(self, topic: str, kind: str, definition: str) -> None:
        """Open the channel of a topic, whose messages are of this type, with the type's text."""
        with self._errors():
            self._mcap.add_channel(topic, kind, definition)

    def add_message(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Write an encoded message of a topic that has a channel; ``stamp_ns`` is ROS time."""
        try:  # without the context, which costs more than the call: there are some twenty messages a cycle
            self._mcap.add_message(topic, stamp_ns, data)
        except OSError as error:
            raise self._error(error) from error

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        with self._errors():
            self._mcap.add_metadata(name, values)

    def flush(self) -> None:
        """Hand all to the system: from here on it outlives this program."""
        with self._errors():
            self._mcap.flush()

    def close(self) -> None:
        """End the file with its index."""
        with self._errors(), self._stream:
            self._mcap.finish()

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._error(error) from error

    def _error(self, error: OSError) -> RecordingError:
        return RecordingError(f"cannot record into {self.path}: {error.strerror or error}")
