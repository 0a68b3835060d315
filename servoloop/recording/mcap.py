"""Write encoded messages to MCAP streams and files. Small chunks keep the file readable if the program is killed."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Annotated, Final

import typer
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

from drivers.driver_errors import DriverError

CHUNK: Final = 256 * 1024
"""Maximum size of a chunk, in bytes. A cycle takes up about 5,000 bytes."""


class McapStream:
    """Writer of encoded ROS 2 messages. Errors of the output (OSError) are raised unchanged.

    The stream contains each channel and message type before the first message that uses it.
    """

    def __init__(self, output: IO[bytes], chunked: bool) -> None:
        """Start the stream.

        If ``chunked`` is true, write compressed chunks and an index. Otherwise, write each message immediately.
        """
        compression = CompressionType.ZSTD if chunked else CompressionType.NONE
        self._writer = Writer(output, CHUNK, compression, use_chunking=chunked)
        self._writer.start(profile=Profile.ROS2)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def has_channel(self, topic: str) -> bool:
        """Return whether a topic has a channel."""
        return topic in self._channels

    def add_channel(self, topic: str, kind: str, definition: str) -> None:
        """Add the channel of a topic, with its message type and the type's definition."""
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, SchemaEncoding.ROS2, definition.encode())
        self._channels[topic] = self._writer.register_channel(topic, MessageEncoding.CDR, self._schemas[kind])

    def add_message(self, topic: str, stamp_ns: int, data: bytes, sequence: int = 0) -> None:
        """Write an encoded message to an existing channel. ``stamp_ns`` is a ROS time."""
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, sequence)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, dict(values))

    def flush(self) -> None:
        """Write all buffered messages to the output."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the index and end the stream."""
        self._writer.finish()  # type: ignore[no-untyped-call]


SUFFIX: Final = ".mcap"
"""File name suffix of recordings."""
RecordOption = Annotated[
    Path | None, typer.Option("--record", metavar="FILE.mcap", help="Record every cycle and all bus traffic.")
]


class RecordingError(DriverError):
    """Raised when a recording cannot be written or read."""


def check_path(path: Path) -> None:
    """Raise RecordingError if no recording can be created at ``path``."""
    if path.suffix != SUFFIX:
        raise RecordingError(f"{path} is not a valid name for a recording: the name must end in {SUFFIX}")
    if "\0" in str(path):
        raise RecordingError(f"{str(path)!r} is not a valid path, because it contains a null character")
    try:
        exists, has_folder = path.exists(), path.parent.is_dir()
    except OSError as error:
        raise RecordingError(f"cannot write the recording {path}: {error.strerror}; choose another path") from error
    if exists:
        raise RecordingError(f"{path} already exists: choose another file name, or delete the file")
    if not has_folder:
        raise RecordingError(f"folder {path.parent} does not exist: create the folder first")


class McapFile:
    """MCAP file. A file that was not closed does not have an index, but contains all messages that were flushed.

    Every method raises RecordingError if the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        """Create the file. Raises RecordingError if the file cannot be created or already exists."""
        self.path = path
        with self._errors():
            self._stream: IO[bytes] = path.open("xb")
        self._mcap = McapStream(self._stream, chunked=True)
        self.has_channel = self._mcap.has_channel

    def add_channel(self, topic: str, kind: str, definition: str) -> None:
        """Add the channel of a topic with a message type and its definition."""
        with self._errors():
            self._mcap.add_channel(topic, kind, definition)

    def add_message(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Write an encoded message to an existing channel. ``stamp_ns`` is ROS time."""
        # This runs about 20 times per cycle. A context manager such as _errors() takes longer than the call itself.
        try:
            self._mcap.add_message(topic, stamp_ns, data)
        except OSError as error:
            raise self._error(error) from error

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        with self._errors():
            self._mcap.add_metadata(name, values)

    def flush(self) -> None:
        """Hand all messages to the operating system, so that they are written even if this program is killed."""
        with self._errors():
            self._mcap.flush()

    def close(self) -> None:
        """Write the index and close the file."""
        with self._errors(), self._stream:
            self._mcap.finish()

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._error(error) from error

    def _error(self, error: OSError) -> RecordingError:
        return RecordingError(f"cannot write the recording {self.path}: {error.strerror or error}")
