"""Commands to a running emulator, over a Unix socket next to the bus. The commands represent manual actions at a
workbench.

Each command and each reply is one line of JSON. The emulator's loop polls the socket without ever waiting.
"""

import contextlib
import json
import socket
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Self

from drivers.driver_errors import PortError
from sim_backend.scene.world_feed import listening

ANSWER_S: Final = 5.0
"""Maximum time that a client waits for a reply from an emulator, in seconds."""
LARGEST_COMMAND_BYTES: Final = 100_000
"""Maximum length of a line, in bytes. A client that sends a longer line is disconnected."""

Command = Mapping[str, Any]
Handler = Callable[[Command], Mapping[str, Any]]


def control_path(link: Path) -> Path:
    """Return the path of the command socket for the bus at ``link``."""
    return link.with_name(link.name + ".control")


class ControlServer:
    """Context manager for the server of the command socket. The emulator's loop must call ``tick``."""

    def __init__(self, path: Path, handle: Handler) -> None:
        """Listen at ``path``.

        ``handle`` executes a command and returns its result, or raises ValueError if the command is invalid.
        """
        self.path = path
        self._handle = handle
        self._clients: dict[socket.socket, bytes] = {}
        self._socket = listening(path)

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    def tick(self) -> None:
        """Execute the commands that have arrived since the last call."""
        with contextlib.suppress(BlockingIOError):
            while True:
                client, _ = self._socket.accept()
                client.setblocking(False)
                self._clients[client] = b""
        for client in list(self._clients):
            self._serve(client)

    def _serve(self, client: socket.socket) -> None:
        try:
            data = client.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        *lines, rest = (self._clients[client] + data).split(b"\n")
        self._clients[client] = rest
        with contextlib.suppress(OSError):
            for line in lines:
                client.sendall(json.dumps(self._answer(line)).encode() + b"\n")
        if not data or len(rest) > LARGEST_COMMAND_BYTES:
            client.close()
            del self._clients[client]

    def _answer(self, line: bytes) -> Mapping[str, Any]:
        try:
            command = json.loads(line)
            if not isinstance(command, dict):
                raise ValueError('a command must be a JSON object, such as {"do": "look"}')
            return self._handle(command)
        except (ValueError, TypeError, LookupError, ArithmeticError, RecursionError) as error:
            return {"error": str(error) or type(error).__name__}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for end in (*self._clients, self._socket):
            end.close()
        self.path.unlink(missing_ok=True)


def ask(path: Path, command: Command) -> dict[str, Any]:
    """Send a command to the emulator at ``path`` and return its reply.

    Raises PortError if no emulator responds, or ValueError if the emulator rejects the command.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(ANSWER_S)
        try:
            line.connect(str(path))
            line.sendall(json.dumps(command).encode() + b"\n")
            answer = b""
            while not answer.endswith(b"\n"):
                more = line.recv(65536)
                if not more:
                    raise ConnectionError("the emulator closed the connection")
                answer += more
        except OSError as error:
            why = f" ({error.strerror})" if error.strerror else ""
            bus = path.with_name(path.name.removesuffix(".control"))
            raise PortError(
                f"no emulator serves {bus}{why}: start 'servoloop emulate {bus}', or correct the path"
            ) from error
    found: dict[str, Any] = json.loads(answer)
    if "error" in found:
        raise ValueError(found["error"])
    return found
