"""The stream of messages from a running stack."""

import os
import re
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Final, NamedTuple, Self

from mcap.reader import NonSeekingReader

from drivers.errors import DriverError
from servoloop.recording.mcap_messages import Encoded, Received, decoded, encoded


class LiveError(DriverError):
    """There is nothing to look at, or it cannot be reached."""


SUFFIX: Final = ".sock"
FOLDER: Final = ".folder"
"""Of the link beside the socket, which leads to the arm's own folder."""
_NAME: Final = re.compile(rf"(?P<arm>.+)-(?P<pid>\d+){re.escape(SUFFIX)}")


class RunningStack(NamedTuple):
    """A stack of this user that can be looked at."""

    arm: str
    pid: int
    socket: Path
    folder: Path | None = None
    """The arm's own folder; None if the stack has not said it."""

    @property
    def called(self) -> str:
        """The stack, for messages."""
        return f"{self.arm} (process {self.pid}{f', {self.folder}' if self.folder else ''})"


def live_folder() -> Path:
    """This user's folder: below ``XDG_RUNTIME_DIR``, or where that is not set in the folder of temporary files."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "servoloop" if runtime else Path(tempfile.gettempdir()) / f"servoloop-{os.getuid()}"


def make_live_folder() -> Path:
    """Make this user's folder, for nobody else to read. Raises LiveError where it is somebody else's."""
    folder = live_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise LiveError(f"cannot make {folder}: {error.strerror}") from error
    if found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise LiveError(f"{folder} is not this user's alone: delete it, or set XDG_RUNTIME_DIR to another folder")
    return folder


def socket_path(arm: str, pid: int) -> Path:
    """Where a stack is to be found. The folder may not be there yet."""
    return live_folder() / f"{re.sub(r'[^A-Za-z0-9_.]', '_', arm)}-{pid}{SUFFIX}"


def running_stacks() -> list[RunningStack]:
    """The stacks that run now, by arm and process."""
    return sorted(_answering())


def find_stack(arm: str | None = None) -> RunningStack:
    """Find the running stack with this name, arm's folder or process number. Raises LiveError with advice."""
    running = running_stacks()
    found = [stack for stack in running if arm is None or _is_of(stack, arm)]
    if len(found) == 1:
        return found[0]
    if not running:
        raise LiveError("no stack is running: start one with `servoloop up`, with virtual servos if no --port is given")
    names = ", ".join(stack.called for stack in running)
    if not found:
        raise LiveError(f"no stack of {arm} is running, but of {names}")
    raise LiveError(
        f"several stacks are running: {names}; name one with --arm (its name, its folder or its process number), or "
        "end the others"
    )


def _is_of(stack: RunningStack, arm: str) -> bool:
    """Whether the stack is of this arm. A path is a folder, and never a name: two arms may have folders of one name."""
    if "/" in arm:
        return stack.folder is not None and stack.folder == Path(arm).resolve()
    return arm in (stack.arm, str(stack.pid))


def _answering() -> Iterator[RunningStack]:
    for path in live_folder().glob(f"*{SUFFIX}"):
        parts = _NAME.fullmatch(path.name)
        if parts is None:
            continue
        with socket.socket(socket.AF_UNIX) as probe:
            probe.settimeout(1.0)
            try:
                probe.connect(str(path))
            except OSError:
                path.unlink(missing_ok=True)  # of a program that was killed
                path.with_suffix(FOLDER).unlink(missing_ok=True)
                continue
        yield RunningStack(parts["arm"], int(parts["pid"]), path, _folder_of(path))


def _folder_of(path: Path) -> Path | None:
    """The arm's folder to which the link beside a socket leads."""
    try:
        return path.with_suffix(FOLDER).readlink()
    except OSError:
        return None


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
