"""The stream of messages from a running stack."""

import socket
from collections.abc import Callable, Iterator
from typing import IO, Self

from mcap.reader import NonSeekingReader

from servoloop.live.errors import LiveError
from servoloop.live.folder import RunningStack
from servoloop.recorder.mcap_messages import Encoded, Received, decoded, encoded


class MessageStream:
    """The messages of one source in their order. It ends when the stack ends, or by ``close``."""

    def __init__(self, stream: IO[bytes], close: Callable[[], None]) -> None:
        self._stream, self._close = stream, close

    def __iter__(self) -> Iterator[Received]:
        return decoded(self.encoded())

    def encoded(self) -> Iterator[Encoded]:
        """The messages as they are in the stream, for one who passes them on."""
        return encoded(NonSeekingReader(self._stream))

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
