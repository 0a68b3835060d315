"""Find running stacks and read their message streams."""

import hashlib
import os
import re
import socket
import struct
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Final, NamedTuple, Self

from mcap.reader import NonSeekingReader

from drivers.driver_errors import DriverError
from drivers.paths import resolved
from servoloop.recording.mcap_messages import Encoded, Received, decoded, encoded


class LiveError(DriverError):
    """Raised when no running stack can be found or reached."""


SUFFIX: Final = ".sock"
FOLDER: Final = ".folder"
"""Suffix of the symbolic link next to the socket, which points to the arm's folder."""
COMMANDS: Final = ".command"
"""Suffix of the stack's command socket, which is in the same folder as the socket of the message stream."""
NAME: Final = ".name"
"""Suffix of the symbolic link that contains the full name of a stack whose sockets have a shortened name."""
CONNECT_S: Final = 2.0
"""Maximum time to wait for a connection, in seconds."""
LONGEST_PATH: Final = 107
"""Maximum length of a socket's path on Linux, in bytes."""
LONGEST_FILE_NAME: Final = 200
"""Maximum length of a stack's name in the names of new files, in characters. File systems allow 255 bytes."""
NEW_COMMANDS: Final = f"{COMMANDS}.new"
"""Suffix of the command socket before it listens. No other socket of a stack has a longer suffix."""
_NAME: Final = re.compile(r"(?:(?P<namespace>[\w.]+)@)?(?P<arm>[^@]+)")
_FILE_NAME: Final = re.compile(rf"(?P<name>.+)-(?P<pid>\d+){re.escape(SUFFIX)}")


class RunningStack(NamedTuple):
    """Running stack of this user."""

    arm: str
    """Name of the arm. Characters that are not allowed in the names of sockets are replaced by underscores."""
    pid: int
    socket: Path
    folder: Path | None = None
    """Folder of the arm, or None if it is unknown."""
    namespace: str = ""
    """ROS namespace of the stack, such as ``/left``, or an empty string for the root namespace."""

    @property
    def name(self) -> str:
        """Name of the arm, with the namespace of its stack."""
        return f"{self.arm} in {self.namespace}" if self.namespace else self.arm

    @property
    def file_name(self) -> str:
        """Name of the stack to use in the names of new files. A very long name is cut off."""
        return stack_name(self.arm, self.namespace)[:LONGEST_FILE_NAME]

    @property
    def commands(self) -> Path:
        """Path of the stack's command socket."""
        return self.socket.with_suffix(COMMANDS)

    @property
    def label(self) -> str:
        """Description of the stack to use in messages."""
        return f"{self.name} (process {self.pid}{f', {self.folder}' if self.folder else ''})"


def live_folder() -> Path:
    """Return this user's folder for sockets, which is in ``XDG_RUNTIME_DIR`` or else in the temporary folder."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "servoloop" if runtime else Path(tempfile.gettempdir()) / f"servoloop-{os.getuid()}"


def make_live_folder() -> Path:
    """Create this user's socket folder, which only this user can read. Raises LiveError if the folder belongs to
    another user."""
    folder = live_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise LiveError(f"cannot create {folder}: {error.strerror}") from error
    if found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise LiveError(
            f"another user owns or can read {folder}: delete this folder, or set XDG_RUNTIME_DIR to another folder"
        )
    return folder


def stack_name(arm: str, namespace: str = "") -> str:
    """Return the name of a stack as it appears in file names, such as ``left@so101``."""
    owner = f"{namespace[1:].replace('/', '.')}@" if namespace else ""
    return f"{owner}{_in_file_names(arm)}"


def socket_path(arm: str, pid: int, namespace: str = "") -> Path:
    """Return the path of a stack's socket. The socket's folder may not exist yet.

    A hash replaces the name of the stack if the paths of its sockets would otherwise be too long. Raises LiveError if
    the path of the folder is too long.
    """
    name = stack_name(arm, namespace)
    for stem in (name, hashlib.sha256(name.encode()).hexdigest()[:8]):
        path = live_folder() / f"{stem}-{pid}{SUFFIX}"
        if len(os.fsencode(path.with_suffix(NEW_COMMANDS))) <= LONGEST_PATH:
            return path
    raise LiveError(f"the path of {live_folder()} is too long for sockets: set XDG_RUNTIME_DIR to a shorter path")


def _in_file_names(arm: str) -> str:
    """Return the name of an arm as it appears in the names of sockets."""
    return re.sub(r"[^A-Za-z0-9_.]", "_", arm)


def running_stacks() -> list[RunningStack]:
    """Return all running stacks, sorted by arm and process ID."""
    return sorted(_answering())


def find_stack(arm: str | None = None, namespace: str | None = None) -> RunningStack:
    """Find a running stack.

    Args:
        arm: Name of the arm, its folder or the process ID of the stack; None matches any arm.
        namespace: ROS namespace of the stack, such as ``/left``; an empty string is the root namespace, and None
            matches any.

    Raises:
        LiveError: No stack matches, or several stacks match.
    """
    running = running_stacks()
    found = matching(running, arm, namespace)
    if len(found) == 1:
        return found[0]
    if not running:
        raise LiveError("no stack is running: start one with `servoloop up`, which uses virtual servos without --port")
    names = ", ".join(stack.label for stack in running)
    if not found:
        wanted = (f" of {arm}" if arm is not None else "") + (
            f" in the namespace {namespace or '/'}" if namespace is not None else ""
        )
        raise LiveError(f"no stack{wanted} is running. Running stacks: {names}")
    raise LiveError(
        f"several stacks are running: {names}. Choose one with --arm (name, folder or process ID) or "
        "--namespace, or stop the other stacks"
    )


def matching(stacks: Sequence[RunningStack], arm: str | None, namespace: str | None) -> list[RunningStack]:
    """Return the stacks that match an arm and a namespace, given as for ``find_stack``."""
    return [stack for stack in stacks if _is_of(stack, arm, namespace)]


def _is_of(stack: RunningStack, arm: str | None, namespace: str | None) -> bool:
    """Return whether a stack belongs to an arm, given by name, folder or process ID, and to a namespace.

    A path is never interpreted as a name.
    """
    if namespace is not None and namespace != stack.namespace:
        return False
    if arm is None:
        return True
    if "/" in arm:
        return stack.folder is not None and stack.folder == resolved(arm)
    return _in_file_names(arm) == stack.arm or arm == str(stack.pid)


def _answering() -> Iterator[RunningStack]:
    for path in live_folder().glob(f"*{SUFFIX}"):
        file = _FILE_NAME.fullmatch(path.name)
        parts = _NAME.fullmatch(_link(path, NAME) or file["name"]) if file else None
        if file is None or parts is None:
            continue
        with socket.socket(socket.AF_UNIX) as probe:
            probe.settimeout(1.0)
            try:
                probe.connect(str(path))
            except (ConnectionRefusedError, FileNotFoundError):
                for suffix in (SUFFIX, FOLDER, NAME, COMMANDS):  # the program was killed
                    path.with_suffix(suffix).unlink(missing_ok=True)
                continue
            except OSError:
                pass  # the stack is running, but is paused or too busy to accept another connection
        namespace = "/" + parts["namespace"].replace(".", "/") if parts["namespace"] else ""
        folder = _link(path, FOLDER)
        yield RunningStack(parts["arm"], int(file["pid"]), path, Path(folder) if folder else None, namespace)


def _link(path: Path, suffix: str) -> str:
    """Return the target of a symbolic link next to a socket, or an empty string if there is no link."""
    try:
        return os.readlink(path.with_suffix(suffix))
    except OSError:
        return ""


class MessageStream:
    """Messages of a running stack. The stream ends when the stack ends or the stream is closed."""

    def __init__(self, stream: IO[bytes], close: Callable[[], None]) -> None:
        self._stream, self._close = stream, close

    def __iter__(self) -> Iterator[Received]:
        return decoded(self.encoded())

    def encoded(self) -> Iterator[Encoded]:
        """Yield the messages without decoding them."""
        return encoded(NonSeekingReader(self._stream))

    def close(self) -> None:
        """Close the stream. May be called from any thread."""
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_live(stack: RunningStack) -> MessageStream:
    """Open the message stream of a running stack. Raises LiveError if the stack has just stopped, or is paused and
    its queue of connections is full."""
    connection = socket.socket(socket.AF_UNIX)
    # The timeout for sending also limits the time that connect() waits for a place in the queue.
    limit = struct.pack("ll", int(CONNECT_S), round(CONNECT_S % 1.0 * 1e6))  # seconds and microseconds
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
    try:
        connection.connect(str(stack.socket))
    except (ConnectionRefusedError, FileNotFoundError) as error:
        connection.close()
        raise LiveError(f"the stack of {stack.arm} has just stopped") from error
    except OSError as error:
        connection.close()
        text = f"the stack of {stack.label} does not accept connections: continue it if it is paused, or restart it"
        raise LiveError(text) from error

    def close() -> None:
        try:
            connection.shutdown(socket.SHUT_RDWR)  # This wakes up the thread that is reading.
        except OSError:
            return
        finally:
            connection.close()

    return MessageStream(connection.makefile("rb"), close)
