"""A new MCAP file of encoded messages, in small chunks, so that what a killed program leaves can be read."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from servoloop.recorder.mcap_stream import McapStream
from servoloop.recorder.record_option import RecordingError


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
