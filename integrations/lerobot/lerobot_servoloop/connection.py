"""Connect to a running servoloop stack over its command socket (docs/socket.md of servoloop)."""

import json
import os
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any, Final

VERSION: Final = 1
"""Version of the command socket's protocol."""
TIMEOUT_S: Final = 5.0
"""Default time to wait for a reply, in seconds."""
SUFFIX: Final = ".command"
"""Suffix of command sockets."""
NAME: Final = ".name"
"""Suffix of the symbolic link that contains the full name of a stack whose sockets have a shortened name."""


class StackError(ConnectionError):
    """Error if a stack cannot be reached or has refused a message. ``kind`` is the type of the error in
    docs/socket.md."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class StackConnection:
    """Connection to the command socket of one stack. All methods raise StackError if they fail."""

    def __init__(self, path: Path, name: str) -> None:
        """Connect to a command socket.

        Args:
            path: Path of the socket.
            name: Name of this program, for messages to other clients.

        Raises:
            StackError: The stack has stopped (kind ``ended``), or does not accept this client.
        """
        stem, _, self.pid = path.stem.rpartition("-")
        """Process ID of the stack."""
        owner, separator, self.arm = (_long_name(path) or stem).rpartition("@")
        """Name of the arm."""
        self.namespace = f"/{owner.replace('.', '/')}" if separator else ""
        """ROS namespace of the stack, such as ``/left``; empty for the root namespace."""
        self.lost = ""
        """Reason why this client has lost control of the motion; empty if it has not."""
        self._number = 0
        self._socket = socket.socket(socket.AF_UNIX)
        self._lines = self._socket.makefile("rb")
        try:
            self._socket.settimeout(TIMEOUT_S)
            self._socket.connect(str(path))
            hello = self.request("hello", client=f"{name} (process {os.getpid()})")
        except StackError:
            self.close()
            raise
        except OSError as error:
            self.close()
            raise StackError("ended", f"the socket {path} cannot be opened: {error.strerror or error}") from error
        self.arm = str(hello["arm"])
        self.folder: str | None = hello["folder"]
        """Folder of the arm, if the arm has one."""

    @property
    def label(self) -> str:
        """Description of the stack for messages."""
        place = f" in {self.namespace}" if self.namespace else ""
        return f"{self.arm}{place} (process {self.pid})"

    def request(self, op: str, timeout_s: float = TIMEOUT_S, **fields: Any) -> dict[str, Any]:
        """Send a message and return the reply.

        Args:
            op: Name of the message.
            timeout_s: Maximum time to wait for each part of the reply, in seconds.
            **fields: Other fields of the message.

        Raises:
            StackError: The stack refuses the message, does not reply, or has stopped.
        """
        self._number += 1
        message = {"v": VERSION, "id": self._number, "op": op, **fields}
        try:
            self._socket.settimeout(timeout_s)
            self._send(json.dumps(message, allow_nan=False).encode() + b"\n")
            return self._reply()
        except TimeoutError as error:
            self.close()  # a late reply would be taken for the reply to the next message
            text = f"the stack of {self.label} does not reply within {timeout_s:g} s: check its log"
            raise StackError("timeout", text) from error
        except StackError:
            raise
        except (OSError, ValueError) as error:
            raise self._ended() from error

    def send_targets(self, positions: dict[str, float]) -> None:
        """Send the next targets of the open stream, in rad or m."""
        self.request("targets", positions=positions, sent_s=monotonic())

    def close(self) -> None:
        """Disconnect. The stack ends the motions of this client within the limits, and the arm holds its position."""
        self._lines.close()
        self._socket.close()

    def _send(self, line: bytes) -> None:
        """Send a message. A stack that refuses a client replies before it closes the connection."""
        try:
            self._socket.sendall(line)
        except BrokenPipeError:
            self._reply()
            raise

    def _reply(self) -> dict[str, Any]:
        while line := self._lines.readline():
            message = json.loads(line)
            if message.get("event") == "lost":
                self.lost = str(message["text"])
            if "event" in message:
                continue  # the event with the result of a goal also has the field ok
            if message.get("ok") is False and message["id"] in (self._number, None):
                raise self._refusal(message["error"])
            if message.get("id") == self._number:
                return dict(message)
        raise self._ended()

    def _refusal(self, error: dict[str, Any]) -> StackError:
        kind, text = str(error["type"]), str(error["text"])
        if kind == "version":
            text += f". Install the version of this plugin that belongs to the stack of {self.label}"
        elif kind == "not_owner" and self.lost:
            text = f"LeRobot no longer moves {self.arm}, because {self.lost.partition(':')[0]}: start LeRobot again"
        return StackError(kind, text)

    def _ended(self) -> StackError:
        text = f"the connection to the stack of {self.label} has ended: start `servoloop up` again"
        return StackError("ended", text)


def find_stack_connection(arm: str | None, namespace: str | None, name: str) -> StackConnection:
    """Connect to the only running stack, or to the stack of a given arm or namespace.

    Args:
        arm: Name of the arm, its folder, or the process ID of the stack. None matches every arm.
        namespace: ROS namespace of the stack, such as ``left``; empty for the root namespace. None matches every
            namespace.
        name: Name of this program, for messages to other clients.

    Raises:
        StackError: No stack matches, several match, or the stack does not accept this client.
    """
    refused: list[StackError] = []
    connected = list(_connections(name, refused))
    found = [one for one in connected if _is_of(one, arm, namespace)]
    for one in connected:
        if len(found) != 1 or one is not found[0]:
            one.close()
    if len(found) == 1:
        return found[0]
    if not found and refused:
        raise refused[0]
    names = ", ".join(one.label for one in connected)
    if not connected:
        raise StackError("not_found", "no servoloop stack is running: start one with `servoloop up`")
    if not found:
        wanted = "" if arm is None else f" of {arm}"
        wanted += "" if namespace is None else f" in the namespace {_absolute(namespace) or '/'}"
        raise StackError("not_found", f"no stack{wanted} is running. Running stacks: {names}")
    raise StackError(
        "not_found",
        f"several stacks are running: {names}. Choose one with the option `arm` (name, folder or process ID) or "
        "`namespace`",
    )


def _connections(name: str, refused: list[StackError]) -> Iterator[StackConnection]:
    """Yield a connection to each running stack, and add the errors of stacks that refuse it to ``refused``."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime) / "servoloop" if runtime else Path(tempfile.gettempdir()) / f"servoloop-{os.getuid()}"
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        try:
            yield StackConnection(path, name)
        except StackError as error:
            if error.kind != "ended":  # a program that was killed leaves its socket behind
                refused.append(error)


def _long_name(path: Path) -> str:
    """Return the full name of a stack whose socket has a shortened name, or else an empty string."""
    try:
        return os.readlink(path.with_suffix(NAME))
    except OSError:
        return ""


def _absolute(namespace: str) -> str:
    """Return a namespace with a slash at its start; empty for the root namespace."""
    return f"/{namespace.strip('/')}" if namespace.strip("/") else ""


def _is_of(stack: StackConnection, arm: str | None, namespace: str | None) -> bool:
    """Return whether a stack runs the given arm (a name, a folder or a process ID) in the given namespace."""
    if namespace is not None and stack.namespace != _absolute(namespace):
        return False
    if arm is None:
        return True
    if "/" in arm:
        return stack.folder is not None and stack.folder == os.path.realpath(arm)
    return arm in (stack.arm, stack.pid)
