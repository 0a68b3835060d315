"""A stream of messages from a running stack or from a recording: both are MCAP."""

import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Message, Schema

from servoloop.live.errors import LiveError
from servoloop.live.folder import RunningStack
from servoloop.recorder.definitions import typestore


class Received(NamedTuple):
    """A message with its topic; ``sequence`` counts the cycles of a live stack, so that a gap is seen."""

    topic: str
    stamp_ns: int
    """ROS time."""
    message: Any
    sequence: int


class MessageStream:
    """The messages of one source in their order. It ends where the stack or the file ends, or by ``close``."""

    def __init__(self, stream: IO[bytes], close: Callable[[], None]) -> None:
        self._stream, self._close = stream, close

    def __iter__(self) -> Iterator[Received]:
        decode = typestore().deserialize_cdr
        for schema, channel, message in self.encoded():
            yield Received(channel.topic, message.log_time, decode(message.data, schema.name), message.sequence)

    def encoded(self) -> Iterator[tuple[Schema, Channel, Message]]:
        """The messages as they are in the stream, for one who passes them on."""
        try:
            for schema, channel, message in NonSeekingReader(self._stream).iter_messages(log_time_order=False):
                if schema is not None:
                    yield schema, channel, message
        except (McapError, struct.error, OSError, ValueError):  # cut off in the middle of a record, or closed
            return

    def close(self) -> None:
        """End it, from any thread."""
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_live(stack: RunningStack) -> MessageStream:
    """The messages of a running stack from now on. Raises LiveError where it has just ended."""
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.connect(str(stack.socket))
    except OSError as error:
        connection.close()
        raise LiveError(f"the stack of {stack.arm} has just ended") from error

    def close() -> None:
        try:
            connection.shutdown(socket.SHUT_RDWR)  # wakes up the thread that reads
        except OSError:
            return
        finally:
            connection.close()

    return MessageStream(connection.makefile("rb"), close)


def open_recording(path: Path) -> MessageStream:
    """The messages of a recording, as fast as they are read. Raises LiveError where there is none."""
    try:
        stream = path.open("rb")
    except OSError as error:
        raise LiveError(f"cannot read {path}: {error.strerror}") from error
    return MessageStream(stream, stream.close)
