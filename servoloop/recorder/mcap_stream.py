"""A stream of MCAP records into whatever takes bytes: a file, or the socket of somebody who looks on."""

from collections.abc import Mapping
from typing import IO, Final

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

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
