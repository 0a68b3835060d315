"""Control loop that a script runs itself, from its start until ``close``."""

import atexit
from contextlib import AbstractContextManager, ExitStack
from typing import Final

from drivers.clock import Clock
from servoloop.api.errors import ArmEndedError
from servoloop.api.stack_backend import StackBackend
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareSetup
from servoloop.stack.loop_thread import LEFT
from servoloop.stack.robot_files import Files, InitialStates, initial_states

CLOSED: Final = "the arm has been shut down: create a new Arm to move it again"
"""Message of calls after ``close``."""


def ended_by(error: Exception | None) -> str:
    """Return the message of calls after the loop has ended because of ``error``."""
    why = f": {error}" if error else ""
    return f"the control loop has ended{why}. {LEFT.capitalize()}; create a new Arm"


class OwnLoop:
    """Stack of one arm with its loop, from its start until ``close``."""

    def __init__(self, files: Files) -> None:
        self._files = files
        self._initial: InitialStates = initial_states(files)
        self._exit = ExitStack()
        self._why_ended = ""
        """Message of calls after the end of the loop; empty while it runs."""
        self._closed = False
        self.backend: StackBackend

    def ended(self) -> ArmEndedError | None:
        """Return why the loop has ended, or None while it runs."""
        return ArmEndedError(self._why_ended) if self._why_ended else None

    def close(self) -> None:
        """Shut the arm down by the rules of its robot file. Raises ArmError if a step fails."""
        raise NotImplementedError

    def _build(self, setup: HardwareSetup, clock: Clock, worker: BackgroundWorker) -> ControlStack:
        stack = ControlStack.build(setup, self._files, clock, worker)
        stack.load_controllers()
        return stack

    def _activate(self, stack: ControlStack, recording: AbstractContextManager[None]) -> None:
        """Record from now on, and enable the torque. A program that does not call ``close`` calls it at its exit."""
        self._exit.enter_context(recording)
        stack.loop.activate(self._initial.inactive)
        self._exit.callback(atexit.unregister, self.close)
        atexit.register(self.close)
