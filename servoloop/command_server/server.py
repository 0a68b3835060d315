"""Listen on the command socket of a stack while its control loop runs."""

import errno
import logging
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from hal.types import JointState
from servoloop.api.arm_errors import ArmEndedError
from servoloop.api.own_loop import describe
from servoloop.api.pace import ThreadPace
from servoloop.api.stack_backend import StackBackend
from servoloop.command_server.connection import SocketConnection, peer_user
from servoloop.command_server.requests import StackRequests
from servoloop.command_socket.command_errors import CommandError
from servoloop.command_socket.messages import encode
from servoloop.recording.stack_recording import StackRecording
from servoloop.recording.stream import COMMANDS, NEW_COMMANDS, LiveError, make_live_folder, socket_path
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.loop_thread import LEFT

LOG = logging.getLogger("servoloop")

MAX_CLIENTS: Final = 16
"""Maximum number of simultaneously connected clients."""
NEWS_S: Final = 0.1
"""Maximum time between two checks for results while no cycles run, in seconds."""
END_S: Final = 2.0
"""Maximum time to wait for a thread when the server closes, in seconds."""


class CommandServer:
    """Command socket of one stack. ``post`` is called in the loop thread; all other work has its own threads."""

    def __init__(self, path: Path, requests: StackRequests) -> None:
        """Create the socket, which only the current user can open.

        Args:
            path: Path of the socket.
            requests: Object that handles the messages.

        Raises:
            LiveError: The socket cannot be created.
        """
        self._path, self._requests = path, requests
        self._connections: list[SocketConnection] = []
        self._ended, self._news = threading.Event(), threading.Event()
        self._server = socket.socket(socket.AF_UNIX)
        # The socket is renamed after it starts to listen and its permissions are set, so that only this user can open
        # it.
        new = path.with_suffix(NEW_COMMANDS)
        try:
            new.unlink(missing_ok=True)
            self._server.bind(str(new))
            new.chmod(0o600)
            self._server.listen(MAX_CLIENTS)
            new.rename(path)
        except OSError as error:
            self._server.close()
            with suppress(OSError):
                new.unlink(missing_ok=True)
            raise LiveError(f"the command socket {path} cannot be created: {error.strerror or error}") from error
        self._threads = [
            threading.Thread(target=work, name=f"commands: {name}", daemon=True)
            for name, work in (("connections", self._accept), ("results", self._notify))
        ]
        for thread in self._threads:
            thread.start()

    def post(self, state: JointState) -> None:
        """Pass on the measurement from a completed cycle without blocking."""
        if self._connections:
            self._news.set()

    def close(self) -> None:
        """Disconnect all clients and remove the socket."""
        self._path.unlink(missing_ok=True)
        self._ended.set()
        self._news.set()
        with suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)  # This wakes up the thread that accepts connections.
        for thread in self._threads:
            thread.join(END_S)
        self._server.close()
        for one in self._connections:
            one.session.post({"event": "end", "text": "the stack ends"})
            one.close()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                connection, _ = self._server.accept()
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                    self._ended.wait(NEWS_S)  # clients wait until the process has free file descriptors again
                    continue
                return
            try:
                self._admit(connection)
            except Exception:  # one client's error must not interrupt the service for the others
                LOG.exception("command socket: a client could not be connected")
                connection.close()

    def _admit(self, connection: socket.socket) -> None:
        pid, user = peer_user(connection)
        self._connections = [one for one in self._connections if not one.gone]
        if user != os.getuid():
            text = f"process {pid} and this stack belong to different users: start your own stack"
            _turn_away(connection, CommandError("foreign_user", text))
        elif len(self._connections) >= MAX_CLIENTS:
            text = f"{MAX_CLIENTS} clients are connected: close one of them"
            _turn_away(connection, CommandError("too_many", text))
        else:
            admitted = SocketConnection(connection, pid, self._requests)
            self._connections = [*self._connections, admitted]
            admitted.start()

    def _notify(self) -> None:
        while not self._ended.is_set():
            self._news.wait(NEWS_S)
            self._news.clear()
            for one in self._connections:
                try:
                    one.session.notify(self._requests.state)
                except Exception:
                    LOG.exception("command socket: a client could not be notified")


def _turn_away(connection: socket.socket, error: CommandError) -> None:
    """Send an error and close the connection, without waiting."""
    with connection, suppress(OSError):
        connection.send(encode({"id": None, "ok": False, "error": error.as_dict()}), socket.MSG_DONTWAIT)


@contextmanager
def command_socket(stack: ControlStack, recording: StackRecording, ended: Callable[[], bool]) -> Iterator[None]:
    """Serve the command socket of a stack while the context is open.

    The loop's previous ``on_cycle`` is called first. If the socket cannot be created, the stack runs without a socket.

    Args:
        stack: The stack, whose loop is not running yet.
        recording: Recordings of the stack.
        ended: Function that returns whether the loop has ended.
    """

    def why_ended() -> ArmEndedError | None:
        return ArmEndedError(f"the control loop of {stack.files.arm} has ended: {LEFT}") if ended() else None

    arm = StackBackend(stack, describe(stack), ThreadPace(stack.loop.clock, why_ended), why_ended, recording)
    try:
        make_live_folder()
        path = socket_path(stack.files.arm, os.getpid(), stack.files.namespace).with_suffix(COMMANDS)
        server = CommandServer(path, StackRequests(stack, arm, recording))
    except LiveError as error:
        LOG.warning("%s", error)
        yield
        return
    shown = stack.loop.on_cycle

    def on_cycle(state: JointState) -> None:
        shown(state)
        server.post(state)

    stack.loop.on_cycle = on_cycle
    try:
        yield
    finally:
        server.close()
        arm.close()
