"""Simulated stack with its command socket. A separate thread runs the cycles as fast as possible."""

import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property

import pytest

from servoloop.command_server.server import command_socket
from servoloop.command_socket.client import CommandClient
from servoloop.recording.stack_recording import StackRecording
from servoloop.recording.stream import RunningStack, running_stacks
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import Files
from tests.live.rig import runtime_folder
from tests.stack.rig import READY


class SocketRig:
    """Active stack at rest whose loop runs in a thread."""

    def __init__(self, stack: SimulatedStack) -> None:
        self.stack = stack
        self.ended = threading.Event()
        self.errors: list[BaseException] = []
        self.pause_s = 0.002
        """Pause after each cycle, in which the threads of the socket run. A longer pause makes the arm slower."""
        self._thread = threading.Thread(target=self._run, daemon=True)

    @cached_property
    def running(self) -> RunningStack:
        """The stack as clients see it."""
        (found,) = running_stacks()
        return found

    def client(self, name: str = "") -> CommandClient:
        """Connect a client."""
        return CommandClient(self.running, name)

    def positions(self) -> list[float]:
        """Commanded positions of the arm."""
        return self.stack.loop.command[:6].tolist()

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self.ended.set()
        self._thread.join(20.0)
        assert not self.errors, self.errors

    def _run(self) -> None:
        try:
            self.stack.run(math.inf, self._paused)
        except BaseException as error:
            self.errors.append(error)

    def _paused(self) -> bool:
        time.sleep(self.pause_s)
        return self.ended.is_set()


@contextmanager
def served(monkeypatch: pytest.MonkeyPatch, files: Files | None = None) -> Iterator[SocketRig]:
    """Run a simulated stack with its message stream and its command socket."""
    with runtime_folder(monkeypatch) as folder:
        monkeypatch.chdir(folder)
        stack = SimulatedStack(files=files, start=(*READY, 0.0), keep_alive=True)
        recording = StackRecording(None)
        rig = SocketRig(stack)
        with (
            recording.of(stack.loop, stack.files, 0.0, lambda: False),
            command_socket(stack.control_stack, recording, rig.ended.is_set),
        ):
            stack.up()
            rig.start()
            try:
                yield rig
            finally:
                rig.end()


def settle(client: CommandClient, goal: int, within_s: float = 20.0) -> dict[str, object]:
    """Wait for the result of a goal."""
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        for event in client.events(0.1):
            if event["event"] == "result" and event["goal"] == goal:
                return event
    raise AssertionError("the goal never ended")
