"""Control loop that a script runs itself, from its start until ``close``."""

import atexit
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from typing import Final

from drivers.clock import Clock
from hal.hal_errors import ArmFileError
from hal.types import joints_of
from servoloop.api.arm_errors import ArmEndedError
from servoloop.api.backend import ArmDescription
from servoloop.api.stack_backend import StackBackend
from servoloop.stack.arm_folders import read_arm
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareSetup
from servoloop.stack.loop_thread import LEFT
from servoloop.stack.pick_place import HAND, load_pick_place
from servoloop.stack.robot_files import Files, InitialStates, initial_states

CLOSED: Final = "the arm has been shut down: create a new Arm to move it again"
"""Error message for calls after ``close``."""


def ended_by(error: Exception | None) -> str:
    """Return the error message for calls after the loop has ended because of ``error``."""
    why = f": {error}" if error else ""
    return f"the control loop has ended{why}. {LEFT.capitalize()}; create a new Arm"


class OwnLoop(ABC):
    """Stack of one arm with its control loop, from the time the loop starts until ``close``."""

    def __init__(self, files: Files) -> None:
        self._files = files
        self._initial: InitialStates = initial_states(files)
        self._exit = ExitStack()
        self._why_ended = ""
        """Error message for calls after the loop has ended, or empty while the loop is running."""
        self._closed = False
        self.backend: StackBackend

    def ended(self) -> ArmEndedError | None:
        """Return an error that states why the loop has ended, or None while the loop is running."""
        return ArmEndedError(self._why_ended) if self._why_ended else None

    @abstractmethod
    def close(self) -> None:
        """Shut the arm down as its robot file specifies. Raises ArmError if a step fails."""
        ...

    def _build(self, setup: HardwareSetup, clock: Clock, worker: BackgroundWorker) -> ControlStack:
        stack = ControlStack.build(setup, self._files, clock, worker)
        stack.load_controllers()
        return stack

    def _activate(self, stack: ControlStack, recording: AbstractContextManager[None]) -> None:
        """Start the recording and enable the torque. Also registers ``close`` to be called when the program exits."""
        self._exit.enter_context(recording)
        stack.loop.activate(self._initial.inactive)
        self._exit.callback(atexit.unregister, self.close)
        atexit.register(self.close)


def describe(stack: ControlStack) -> ArmDescription:
    """Return the properties of an arm for its backend."""
    files, loop = stack.files, stack.loop
    names = joints_of(loop.hardware.command_interfaces)
    joints = tuple(name for name, kind in zip(names, loop.kinds, strict=True) if kind == "position")
    limits = dict(zip(names, loop.limits, strict=True))
    hand = _hand(files, joints)
    opened, closed = _hand_positions(files, hand)
    return ArmDescription(
        files.arm, joints, {j: limits[j] for j in joints}, hand, opened, closed, loop.period_s, files.folder
    )


def _hand(files: Files, joints: Sequence[str]) -> str:
    """Return the joint of the gripper.

    The gripper is the hand controller's only joint, or else the only joint without a trajectory controller.
    """
    by_controller = {spec.name: spec for spec in files.controllers.controllers}
    if HAND in by_controller:
        found = [name for name in joints_of(by_controller[HAND].parameters.claims()) if name in joints]
    else:
        found = [joint for joint in joints if joint in files.hand_joints]
    return found[0] if len(found) == 1 else ""


def _hand_positions(files: Files, hand: str) -> tuple[float, float]:
    """Return the open and closed positions of the gripper.

    The positions come from the arm's pick-and-place parameters. Without these parameters, the joint limits are used.
    """
    if not hand:
        return math.nan, math.nan
    with suppress(ArmFileError):
        if files.folder is not None:
            settings = load_pick_place(read_arm(files.folder).pick_place)
            return settings.hand_open_m, settings.hand_closed_m
    return files.limits[hand].upper, files.limits[hand].lower
